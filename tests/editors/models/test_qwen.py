"""Qwen-Image-Edit and Qwen-Image-Edit-Plus against diffusers' own pipelines, tiny and random."""

from __future__ import annotations

from dataclasses import replace

import diffusers
import pytest
import torch
from closeness import NETWORK, assert_near
from diffusers.pipelines.qwenimage import pipeline_qwenimage_edit, pipeline_qwenimage_edit_plus
from model_laws import (
    PROMPT,
    consensus_law_holds,
    micro_batches_change_nothing,
    views_do_not_mix,
)
from model_runs import (
    as_files,
    assert_deviations_shrink,
    assert_same_steps,
    noise,
    pictures,
    states,
    steps_of,
)
from tiny_qwen_image import tiny_qwen_image

from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch
from gsedit.editors.sampling import DiffusionEditor
from gsedit.errors import UsageError
from gsedit.models.loading import load_model
from gsedit.models.qwen import HEADING, QwenImageEdit, reading_size
from gsedit.models.vision_language import Reader

ALONE = SamplerSettings(strength=1.0, consensus=False, steps=3)
PICTURE_AND_TEXT = Need(none=False)


@pytest.fixture(scope="module")
def plain():
    return tiny_qwen_image()


@pytest.fixture(scope="module")
def plus():
    return tiny_qwen_image(diffusers.QwenImageEditPlusPipeline)


def ours(pipe, most: int = 1024) -> QwenImageEdit:
    plus = isinstance(pipe, diffusers.QwenImageEditPlusPipeline)
    scheduler = FlowScheduler.read(dict(pipe.scheduler.config), "scheduler")
    heading = HEADING if plus else ""
    reader = Reader(
        pipe.text_encoder, pipe.tokenizer, pipe.processor.image_processor, heading, most
    )
    return QwenImageEdit(
        transformer=pipe.transformer,
        vae=pipe.vae,
        reader=reader,
        scheduler=scheduler,
        schedule=scheduler.schedule,
        plus=plus,
    )


def theirs(pipe, images, patch, output: str = "latent", **options) -> list[torch.Tensor]:
    """Steps and the result for one picture, which the pipeline would enlarge to 1024 x 1024."""
    height, width = images.shape[1:3]
    patch.setattr(
        pipeline_qwenimage_edit, "calculate_dimensions", lambda area, ratio: (width, height, None)
    )
    patch.setattr(
        pipeline_qwenimage_edit_plus,
        "calculate_dimensions",
        lambda area, ratio: (
            reading_size(height, width)[::-1] if area == 384**2 else (width, height)
        ),
    )
    steps = steps_of(pipe.scheduler, patch)
    start = noise(ours(pipe), images)
    rows, columns = start.shape[2:]
    packed = pipe._pack_latents(start, 1, start.shape[1], rows, columns)
    result = pipe(
        as_files(images)[0], PROMPT, negative_prompt=" ", height=height, width=width,
        latents=packed, output_type=output, **options,
    ).images  # fmt: skip
    if output != "latent":
        return [result]
    factor = pipe.vae_scale_factor
    return [pipe._unpack_latents(x, height, width, factor)[:, :, 0] for x in steps]


@pytest.mark.parametrize("kind", ["plain", "plus"])
def test_every_step_equals_diffusers(kind, request, monkeypatch):
    pipe, images = request.getfixturevalue(kind), pictures(1)
    expected = theirs(pipe, images, monkeypatch, num_inference_steps=3)
    model = ours(pipe)
    found = states(model, images, noise(model, images), ALONE)
    assert_same_steps(found, expected)
    assert (found[-1] - found[0]).abs().amax() > 0.1


def test_no_guidance_equals_diffusers(plain, monkeypatch):
    images, model = pictures(1), ours(plain)
    expected = theirs(plain, images, monkeypatch, num_inference_steps=2, true_cfg_scale=1.0)
    settings = replace(ALONE, steps=2, guidance_text=1.0)
    assert_same_steps(states(model, images, noise(model, images), settings), expected)


def test_pictures_equal_those_of_diffusers(plain, monkeypatch):
    images, model = pictures(1), ours(plain)
    [expected] = theirs(plain, images, monkeypatch, "pt", num_inference_steps=2)
    *_, x = states(model, images, noise(model, images), replace(ALONE, steps=2))
    shown = expected.movedim(1, -1)
    assert_near(model.decode(x).clamp(0, 1), shown, NETWORK)


def test_encoding_equals_that_of_diffusers(plain):
    images, model = pictures(2), ours(plain)
    x = images.clone().requires_grad_()
    pixels = (2 * x - 1).movedim(-1, 1)[:, :, None]
    expected = plain._encode_vae_image(pixels, torch.Generator())[:, :, 0]
    found = model.encode(x)
    assert_near(found, expected, NETWORK)
    slopes = [torch.autograd.grad(latents.sum(), x)[0] for latents in (found, expected)]
    assert_near(*slopes, NETWORK)


@pytest.mark.parametrize("kind", ["plain", "plus"])
def test_text_is_read_as_diffusers_reads_it(kind, request):
    pipe, images = request.getfixturevalue(kind), pictures(2)
    condition = ours(pipe).condition(images, PROMPT, torch.Generator())
    for view, picture in enumerate(as_files(images)):
        if kind == "plus":
            height, width = reading_size(*images.shape[1:3])
            picture = [pipe.image_processor.resize(picture, height, width)]
        for text, found in ((PROMPT, condition.text), (" ", condition.null)):
            expected, mask = pipe.encode_prompt(text, picture, torch.device("cpu"))
            assert mask is None
            assert_near(found[view], expected[0], NETWORK)
    assert not torch.equal(condition.text[0], condition.text[1])


@pytest.mark.parametrize("size", [(1024, 1024), (720, 1280), (480, 270), (16, 4096)])
def test_pictures_are_read_at_diffusers_size(size):
    height, width = size
    expected = pipeline_qwenimage_edit_plus.calculate_dimensions(384**2, width / height)
    found = reading_size(height, width)
    assert found == (max(expected[1], 32), max(expected[0], 32))


@pytest.mark.parametrize("kind", ["plain", "plus"])
def test_laws(kind, request):
    model, images = ours(request.getfixturevalue(kind)), pictures(3)
    start = noise(model, images)
    micro_batches_change_nothing(model, images, start, Need(none=False))
    views_do_not_mix(model, images[:2], start[:2], Need(none=False))
    consensus_law_holds(model, images[:2], start[:2])
    assert_deviations_shrink(model, 8)


def test_any_size_is_edited(plus):
    """33 by 29 pixels become 40 by 32: the VAE halves twice, and a token is 2 x 2 cells."""
    editor = DiffusionEditor(ours(plus))
    assert (editor.cell, editor.denoiser.multiple, editor.capabilities.best_size) == (4, 8, 1024)
    views = pictures(2, 29, 33)
    request = SamplerSettings(steps=2, precision="float32")
    *_, last = editor.edit(EditBatch(views, views, PROMPT), request, torch.Generator())
    assert last.images.shape == views.shape
    assert last.evaluations == (2 * 2 + 1) * 2  # views, steps and one probe; branches
    assert last.images.isfinite().all()


def test_a_saved_folder_is_the_same_model(plus, tmp_path):
    plus.save_pretrained(tmp_path)
    loaded, model, images = load_model(tmp_path), ours(plus), pictures(1)
    assert loaded.name == "qwen-image-edit-plus"
    start = noise(model, images)
    expected = states(model, images, start, ALONE)
    assert_same_steps(states(loaded, images, start, ALONE), expected)
    assert torch.equal(loaded.decode(start), model.decode(start))


def test_bad_requests_name_the_next_move(plain):
    model = ours(plain, most=len(PROMPT))  # a letter is a token here
    model.check(PROMPT)
    with pytest.raises(UsageError, match="1 tokens"):
        model.check(PROMPT + "!")
    images, settings = pictures(1), replace(ALONE, guidance_image=1.5)
    with pytest.raises(UsageError, match="leave it at 1"):
        states(model, images, noise(model, images), settings)
