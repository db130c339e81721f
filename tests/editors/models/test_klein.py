"""FLUX.2-klein against diffusers' pipelines, tiny and random."""

from dataclasses import replace
from pathlib import Path

import model_laws
import pytest
import torch
from closeness import NETWORK, assert_near
from PIL import Image
from tiny_flux import klein, trace
from torch.nn.functional import pixel_unshuffle

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.models.klein import packed, scheduler_of
from gsedit.paper.models.loading import load_model

pytestmark = pytest.mark.usefixtures("offline")
LENGTH = 24
"""Tokens of an instruction here: 512 would be most of the work."""


def pictures(views: int, height: int = 16, width: int = 24) -> torch.Tensor:
    """Pictures of 8 bits, so that a pipeline that is given files sees the same numbers."""
    generator = torch.Generator().manual_seed(1)
    return torch.randint(256, (views, height, width, 3), generator=generator) / 255


def noise(model, images: torch.Tensor) -> torch.Tensor:
    rows, columns = (side // model.cell for side in images.shape[1:3])
    shape = (len(images), model.vae.config.latent_channels, rows, columns)
    return torch.randn(shape, generator=torch.Generator().manual_seed(2))


KINDS = {"distilled": {}, "guided": {"distilled": False}}


@pytest.fixture(scope="module", params=KINDS)
def both(request, tmp_path_factory):
    pipe = klein(**KINDS[request.param])
    folder = tmp_path_factory.mktemp("klein")
    pipe.save_pretrained(folder)
    return pipe, replace(load_model(folder), length=LENGTH)


@torch.no_grad()
def test_every_step_equals_diffusers(both):
    pipe, model = both
    images = pictures(2, 64, 72)  # the pipeline takes 64 pixels or more
    start = noise(model, images)
    files = [Image.fromarray((255 * image).round().byte().numpy()) for image in images]
    expected = [
        trace(
            pipe,
            prompt=model_laws.PROMPT,
            image=file,
            height=64,
            width=72,
            latents=pixel_unshuffle(x[None], 2),
            num_inference_steps=3,
            max_sequence_length=LENGTH,
            guidance_scale=4.0,
        )
        for file, x in zip(files, start)
    ]
    settings = SamplerSettings(steps=3, strength=1.0, consensus=False)
    steps = list(model_laws.run(model, images, start, settings))
    assert len(steps) == 3
    for step, theirs in zip(steps, zip(*expected)):
        assert_near(packed(step.x), torch.cat(theirs), NETWORK)


@torch.no_grad()
def test_laws(both):
    _, model = both
    images = pictures(3)
    start = noise(model, images)
    model_laws.consensus_law_holds(model, images[:2], start[:2])


@torch.no_grad()
def test_encode_and_decode_equal_the_pipelines(both):
    pipe, model = both
    images = pictures(2, 32, 36)
    pixels = 2 * images.movedim(-1, 1) - 1
    theirs = pipe._encode_vae_image(pixels, torch.Generator())
    ours = model.encode(images)
    assert_near(pixel_unshuffle(ours, 2), theirs, NETWORK)
    mean, variance = (
        each.view(1, -1, 1, 1) for each in (pipe.vae.bn.running_mean, pipe.vae.bn.running_var)
    )
    latents = theirs * (variance + pipe.vae.config.batch_norm_eps).sqrt() + mean
    expected = pipe.vae.decode(pipe._unpatchify_latents(latents)).sample
    assert_near(model.decode(ours), expected.movedim(1, -1) / 2 + 0.5, NETWORK)


@pytest.mark.parametrize(
    ("config", "named"),
    [
        ({"_class_name": "UniPCMultistepScheduler"}, "UniPCMultistepScheduler"),
        ({"time_shift_type": "cubic"}, "time_shift_type"),
        ({"shift": "three"}, "cannot be loaded"),
        ({"invert_sigmas": True}, "invert_sigmas"),
    ],
)
def test_a_bad_schedule_is_refused_by_name(config, named):
    given = {"_class_name": "FlowMatchEulerDiscreteScheduler", **config}
    with pytest.raises(InputError, match=f"(?s)here.json.*{named}"):
        scheduler_of(given, Path("here.json"))


def test_a_spacing_of_another_model_is_refused(both):
    with pytest.raises(UsageError, match="karras"):
        both[1].capabilities.levels(SamplerSettings(spacing="karras"), (16, 16))
