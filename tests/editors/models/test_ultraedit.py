"""InstructPix2Pix of Stable Diffusion 3, tiny and random, against a loop over diffusers' parts.

diffusers has its pipeline only among the examples that are not installed: the loop here does what
that pipeline says, with diffusers' own text features, scheduler and networks.
"""

from __future__ import annotations

from dataclasses import replace

import model_laws
import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_flux import saved, sd3, views

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.settings import SamplerSettings
from gsedit.errors import InputError, UsageError
from gsedit.models.loading import load_model

pytestmark = pytest.mark.usefixtures("offline")
NAME = "StableDiffusion3InstructPix2PixPipeline"
KINDS = {
    "diffusers": {},
    "own": {"own": True},
    "own, with mask": {"own": True, "shown": 2},
    "without T5": {"with_t5": False},
}


@pytest.fixture(scope="module", params=KINDS)
def both(request, tmp_path_factory):
    options = dict(KINDS[request.param])
    version = "0.30.0.dev0" if options.pop("own", False) else "0.34.0"
    pipe = sd3(**options)
    index = {
        "_class_name": "StableDiffusion3InstructPix2PixPipeline",
        "_diffusers_version": version,
    }
    return pipe, load_model(saved(pipe, tmp_path_factory.mktemp("sd3"), **index))


def noise(count: int = 2) -> torch.Tensor:
    return torch.randn(count, 2, 8, 12, generator=torch.Generator().manual_seed(2))


def theirs(pipe, s_T: float, s_I: float, *, own: bool, steps: int = 3) -> list[torch.Tensor]:
    """Latents after each step of the three branches, for each view on its own."""
    text, null, pooled, null_pooled = pipe.encode_prompt(
        model_laws.PROMPT, None, None, negative_prompt="", max_sequence_length=77 if own else 256
    )
    pixels = 2 * views(2, 16, 24).movedim(-1, 1) - 1
    shown = pipe.vae.encode(pixels).latent_dist.mode()
    if not own:
        shown = (shown - pipe.vae.config.shift_factor) * pipe.vae.config.scaling_factor
    if pipe.transformer.config.in_channels == 6:
        white = pipe.vae.encode(torch.ones_like(pixels)).latent_dist.mode()
        shown = torch.cat((shown, white), 1)
    pipe.scheduler.set_timesteps(steps)
    x, kept = noise(), []
    for t in pipe.scheduler.timesteps:
        three = [
            pipe.transformer(
                torch.cat((x, picture), 1),
                encoder_hidden_states=tokens.expand(2, -1, -1),
                pooled_projections=vector.expand(2, -1),
                timestep=t.expand(2),
            ).sample
            for tokens, vector, picture in (
                (text, pooled, shown),
                (null, null_pooled, shown),
                (null, null_pooled, torch.zeros_like(shown)),
            )
        ]
        guided = three[2] + s_T * (three[0] - three[1]) + s_I * (three[1] - three[2])
        x = pipe.scheduler.step(guided, t, x).prev_sample
        kept.append(x)
    return kept


@pytest.mark.parametrize(("s_T", "s_I"), [(7.5, 1.5), (3.0, 1.0)])
@torch.no_grad()
def test_every_step_equals_diffusers(both, s_T, s_I):
    pipe, model = both
    settings = SamplerSettings(
        steps=3, guidance_text=s_T, guidance_image=s_I, strength=1.0, consensus=False
    )
    steps = list(model_laws.run(model, views(2, 16, 24), noise(), settings))
    for step, expected in zip(steps, theirs(pipe, s_T, s_I, own=model.own), strict=True):
        assert_near(step.x, expected, NETWORK)


@torch.no_grad()
def test_micro_batches_change_nothing(both):
    model_laws.micro_batches_change_nothing(both[1], views(3, 16, 24), noise(3), Need())


@torch.no_grad()
def test_views_do_not_mix(both):
    model_laws.views_do_not_mix(both[1], views(2, 16, 24), noise(), Need())


def test_consensus_law(both):
    model_laws.consensus_law_holds(both[1], views(2, 16, 24), noise())


@torch.no_grad()
def test_decode_undoes_encode_as_the_pipelines_do(both):
    pipe, model = both
    config = pipe.vae.config
    x = noise()
    plain = x / config.scaling_factor + (0 if model.own else config.shift_factor)
    expected = pipe.vae.decode(plain).sample.movedim(1, -1) / 2 + 0.5
    assert_near(model.decode(x), expected, NETWORK)
    pictures = views(2, 16, 24)
    mode = pipe.vae.encode(2 * pictures.movedim(-1, 1) - 1).latent_dist.mode()
    shift = 0 if model.own else config.shift_factor
    assert_near(model.encode(pictures), (mode - shift) * config.scaling_factor, NETWORK)


def test_sides_and_a_long_instruction(both):
    _, model = both
    assert (model.cell, model.multiple, model.channels) == (2, 4, 2)
    assert model.size == (512 if model.own else 64)
    limit = 16 if model.t5 is None else 77 if model.own else 256
    model.check("make " * limit)
    with pytest.raises(UsageError, match="1 tokens"):
        model.check("make " * (limit + 1))


@torch.no_grad()
def test_the_instruction_is_heard(both):
    _, model = both
    model = replace(model, micro_batch=2)
    one, other = (
        model.branches(
            noise(), 700.0, model.condition(views(2, 16, 24), text, torch.Generator()), Need()
        ).text_image
        for text in ("make it snow", "snow it")
    )
    assert (one - other).abs().max() > 1e-3


def test_a_model_that_is_shown_no_picture_is_refused(tmp_path):
    with pytest.raises(InputError, match="takes 2 channels"):
        load_model(saved(sd3(shown=0), tmp_path, _class_name=NAME))
