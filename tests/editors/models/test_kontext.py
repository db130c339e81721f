"""FLUX.1-Kontext against diffusers' pipeline, tiny and random."""

from __future__ import annotations

from dataclasses import replace

import model_laws
import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_flux import kontext, saved, trace, views

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.sampler import sample
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import levels_for
from gsedit.errors import UsageError
from gsedit.models.loading import load_model
from gsedit.models.tokens import packed, unpacked

pytestmark = pytest.mark.usefixtures("offline")
LENGTH = 24
"""Tokens of an instruction here: 512 would be most of the work."""
TEXT = Need(True, False, False)


@pytest.fixture(scope="module", autouse=True)
def short():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gsedit.models.kontext.LENGTH", LENGTH)
        yield


@pytest.fixture(scope="module", params=[True, False], ids=["weighted", "plain"])
def both(request, tmp_path_factory):
    pipe = kontext(weighted=request.param)
    return pipe, load_model(saved(pipe, tmp_path_factory.mktemp("kontext")))


def noise(count: int = 2) -> torch.Tensor:
    return torch.randn(count, 2, 8, 12, generator=torch.Generator().manual_seed(2))


def theirs(pipe, **options) -> list[torch.Tensor]:
    return trace(
        pipe,
        image=views(2, 16, 24).movedim(-1, 1),
        prompt=[model_laws.PROMPT] * 2,
        height=16,
        width=24,
        max_area=16 * 24,
        latents=packed(noise()),
        num_inference_steps=3,
        max_sequence_length=LENGTH,
        _auto_resize=False,
        **options,
    )


def same(steps, expected) -> None:
    for step, theirs in zip(steps, expected, strict=True):
        assert_near(packed(step.x), theirs, NETWORK)


SETTINGS = SamplerSettings(steps=3, strength=1.0, consensus=False)


@torch.no_grad()
def test_every_step_equals_diffusers(both):
    pipe, model = both
    guidance = 3.0 if model.guidance else 1.0
    settings = replace(SETTINGS, guidance_text=guidance)
    steps = model_laws.run(model, views(2, 16, 24), noise(), settings)
    same(steps, theirs(pipe, guidance_scale=guidance))


@torch.no_grad()
def test_true_guidance_equals_diffusers(both):
    """Two branches with s_I = 1: the instruction, and one to push away from."""
    pipe, model = both
    model = replace(model, negative="snow it", guidance=model.guidance and 3.0)
    settings = replace(SETTINGS, guidance_text=4.0, guidance_image=1.0, steps=3)
    condition = model.condition(views(2, 16, 24), model_laws.PROMPT, torch.Generator())
    steps = sample(model, condition, noise(), settings, levels=levels_for(model, settings, (8, 12)))
    expected = theirs(pipe, guidance_scale=3.0, true_cfg_scale=4.0, negative_prompt=["snow it"] * 2)
    same(steps, expected)


@torch.no_grad()
def test_micro_batches_change_nothing(both):
    model = replace(both[1], negative="snow")
    model_laws.micro_batches_change_nothing(model, views(3, 16, 24), noise(3), Need())


@torch.no_grad()
def test_views_do_not_mix(both):
    model_laws.views_do_not_mix(both[1], views(2, 16, 24), noise(), TEXT)


def test_consensus_law(both):
    model_laws.consensus_law_holds(both[1], views(2, 16, 24), noise())


@torch.no_grad()
def test_encode_and_decode_equal_the_pipelines(both):
    pipe, model = both
    pictures = views(2, 16, 24)
    latents = model.encode(pictures)
    pixels = 2 * pictures.movedim(-1, 1) - 1
    assert_near(latents, pipe._encode_vae_image(pixels, torch.Generator()), NETWORK)
    plain = latents / pipe.vae.config.scaling_factor + pipe.vae.config.shift_factor
    expected = pipe.vae.decode(plain).sample.movedim(1, -1) / 2 + 0.5
    assert_near(model.decode(latents), expected, NETWORK)


def test_packing_is_the_pipelines(both):
    pipe, _ = both
    x = noise()
    expected = pipe._pack_latents(x, 2, 2, 8, 12)
    assert torch.equal(packed(x), expected)
    assert torch.equal(unpacked(expected, 4, 6), x)


@torch.no_grad()
def test_the_weight_is_an_input_of_the_network(both):
    _, model = both
    with_weight = model.capabilities.with_text_weight
    if model.guidance is None:
        assert with_weight is None
        return
    condition = model.condition(views(2, 16, 24), model_laws.PROMPT, torch.Generator())
    one, other = (
        with_weight(weight).branches(noise(), 700.0, condition, TEXT).text_image
        for weight in (1.0, 6.0)
    )
    assert (one - other).abs().max() > 1e-3
    with pytest.raises(UsageError, match="negative instruction"):
        model.branches(noise(), 700.0, condition, Need())


def test_sides_and_a_long_instruction(both):
    _, model = both
    assert (model.cell, model.multiple, model.channels, model.size) == (2, 4, 2, 256)
    model.check("make " * LENGTH)
    with pytest.raises(UsageError, match="1 tokens"):
        model.check("make " * (LENGTH + 1))
