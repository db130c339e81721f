"""DreamLite and DreamLite-mobile against diffusers' own pipelines, tiny and random."""

from __future__ import annotations

from dataclasses import replace

import diffusers
import pytest
import torch
from closeness import NETWORK, assert_near
from model_laws import PROMPT, consensus_law_holds, micro_batches_change_nothing, views_do_not_mix
from model_runs import (
    as_files,
    assert_deviations_shrink,
    assert_same_steps,
    noise,
    pictures,
    states,
    steps_of,
)
from tiny_dreamlite import tiny_dreamlite

from gsedit.paper.diffusion.flow import FlowScheduler
from gsedit.paper.diffusion.guidance import Need
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.models.dreamlite import INSTRUCTION, DreamLite, Reader
from gsedit.paper.models.loading import load_model

ALONE = SamplerSettings(strength=1.0, consensus=False)


@pytest.fixture(scope="module")
def base():
    return tiny_dreamlite()


@pytest.fixture(scope="module")
def mobile():
    return tiny_dreamlite(diffusers.DreamLiteMobilePipeline)


def ours(pipe, *, distilled: bool = False, most: int = 200) -> DreamLite:
    scheduler = FlowScheduler.read(dict(pipe.scheduler.config), "scheduler")
    patches = pipe.processor.image_processor
    return DreamLite(
        unet=pipe.unet,
        vae=pipe.vae,
        reader=Reader(pipe.text_encoder, pipe.tokenizer, patches, most=most),
        scheduler=scheduler,
        schedule=scheduler.schedule,
        distilled=distilled,
    )


def theirs(pipe, images, monkeypatch, **options) -> list[torch.Tensor]:
    """The pipeline's steps for one picture, from the noise of `noise(model, images)`."""
    steps = steps_of(pipe.scheduler, monkeypatch)
    generator = torch.Generator().manual_seed(2)
    pipe(PROMPT, image=as_files(images)[0], generator=generator, output_type="latent", **options)
    return steps


@pytest.mark.parametrize(("steps", "s_T", "s_I"), [(4, 3.5, 1.5), (3, 5.0, 1.0)])
def test_every_step_equals_diffusers(base, monkeypatch, steps, s_T, s_I):
    images, model = pictures(1), ours(base)
    expected = theirs(
        base, images, monkeypatch, num_inference_steps=steps, guidance_scale=s_T,
        image_guidance_scale=s_I,
    )  # fmt: skip
    settings = replace(ALONE, steps=steps, guidance_text=s_T, guidance_image=s_I)
    found = states(model, images, noise(model, images), settings)
    assert_same_steps(found, expected)
    assert (found[-1] - found[0]).abs().amax() > 0.1


def test_every_step_of_mobile_equals_diffusers(mobile, monkeypatch):
    images, model = pictures(1), ours(mobile, distilled=True)
    found = states(model, images, noise(model, images), ALONE)
    assert_same_steps(found, theirs(mobile, images, monkeypatch))
    assert len(found) == 4


def test_text_is_read_as_diffusers_reads_it(base):
    """Beside the picture of its own view; filled up on neither side."""
    images, model = pictures(2), ours(base)
    condition = model.condition(images, PROMPT, torch.Generator())
    for view, picture in enumerate(as_files(images)):
        expected, mask = base.encode_prompt(
            "edit", ["", INSTRUCTION.format(PROMPT)], torch.device("cpu"), torch.float32, picture
        )
        null, text = (row[seen.bool()] for row, seen in zip(expected, mask))
        assert_near(condition.null[view], null, NETWORK)
        assert_near(condition.text[view], text, NETWORK)
    assert not torch.equal(condition.text[0], condition.text[1])


@pytest.mark.parametrize("distilled", [False, True])
def test_laws(base, mobile, distilled):
    model = ours(mobile, distilled=True) if distilled else ours(base)
    need = Need(image=not distilled, none=not distilled)
    images = pictures(3)
    start = noise(model, images)
    micro_batches_change_nothing(model, images, start, need)
    views_do_not_mix(model, images[:2], start[:2], need)
    consensus_law_holds(model, images[:2], start[:2])
    assert_deviations_shrink(model, 4 if distilled else 8)


def test_a_saved_folder_is_the_same_model(mobile, tmp_path):
    """Its processor needs no torchvision."""
    mobile.save_pretrained(tmp_path)
    loaded = load_model(tmp_path)
    images, model = pictures(1), ours(mobile, distilled=True)
    start = noise(model, images)
    expected = states(model, images, start, ALONE)
    assert (loaded.name, loaded.size) == ("dreamlite-mobile", 256)
    assert_same_steps(states(loaded, images, start, ALONE), expected)
