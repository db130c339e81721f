"""`small` as a denoiser and as an editor, with any weights and with those that come with gsedit."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import NETWORK, assert_near
from small_networks import random_network

from gsedit.bench.synthetic import demo_scene, ring_cameras
from gsedit.errors import UsageError
from gsedit.paper.diffusion.guided import predict_guided
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import EditBatch, make_editor
from gsedit.paper.editors.sampling import DiffusionEditor
from gsedit.paper.editors.small.editor import (
    Small,
    SmallEditor,
)
from gsedit.paper.editors.small.network import CELL_PIXELS, CHANNELS
from gsedit.words.looks import LOOKS

SETTINGS = SamplerSettings(steps=2)
GOLD, TWO = LOOKS["gold"].wording, "a golden statue in the snow"


@pytest.fixture(scope="module")
def small() -> Small:
    return Small(random_network())


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def pictures(views: int, height: int, width: int) -> torch.Tensor:
    return torch.rand(views, height, width, 3, generator=torch.Generator().manual_seed(1))


def test_the_latents_are_the_pixels(small):
    images = pictures(2, 16, 24)
    latents = small.encode(images)
    assert latents.shape == (2, 48, 16 // CELL_PIXELS, 24 // CELL_PIXELS)
    torch.testing.assert_close(small.decode(latents), images)
    torch.testing.assert_close(latents.norm(), (2 * images - 1).norm())


def test_micro_batches_change_nothing():
    network = random_network()
    originals, x = pictures(5, 16, 16), noise(5, CHANNELS, 4, 4)
    predictions = []
    for size in (1, 2, 5):
        model = Small(network, micro_batch=size)
        condition = model.condition(originals, "make it snow", torch.Generator())
        predictions.append(
            predict_guided(model, condition, x, model.schedule.level(500), SamplerSettings())
        )
    for other in predictions[1:]:
        assert_near(other, predictions[0], NETWORK)


def edit(editor, images, prompt=GOLD, seed=0, **settings):
    batch = EditBatch(images=images, originals=images, prompt=prompt)
    sampler = SamplerSettings(**{"steps": 3} | settings)
    *_, last = editor.edit(batch, sampler, torch.Generator().manual_seed(seed))
    return last.images


def test_where_the_subject_is_can_be_told(small):
    """Told nothing new, nothing changes; told otherwise, the edit is another one there."""
    originals = pictures(2, 16, 32)
    generator = torch.Generator().manual_seed(0)
    own = small.condition(originals, GOLD, generator).shown.subject.unflatten(1, (16, 32))

    def edited(subject):
        batch = EditBatch(originals, originals, GOLD, subject=subject)
        settings = SamplerSettings(steps=2, precision="float32")
        *_, last = SmallEditor(small).edit(batch, settings, torch.Generator().manual_seed(0))
        return last.images

    told = replace(small, subject=own).condition(originals, GOLD, generator).shown.subject
    assert_near(told, own.flatten(1), NETWORK)
    assert_near(edited(own), edited(None), NETWORK)
    left = torch.zeros(2, 16, 32)
    left[:, :, :16] = 1
    assert (edited(left) - edited(1 - left)).abs().max() > 1e-3


def batch(prompt: str, views: int = 2) -> EditBatch:
    images = torch.rand(views, 16, 16, 3, generator=torch.Generator().manual_seed(0))
    return EditBatch(images, images, prompt)


def run(editor, batch: EditBatch):
    return list(editor.edit(batch, SETTINGS, torch.Generator().manual_seed(0)))


def test_two_looks_are_two_passes_the_subjects_first(small):
    steps = run(SmallEditor(small), batch(TWO))
    assert [p.step for p in steps] == sorted(p.step for p in steps)
    assert {p.steps for p in steps} == {2 * SETTINGS.steps}
    assert [p.images is not None for p in steps] == [False] * (len(steps) - 1) + [True]
    generator = torch.Generator().manual_seed(0)
    asked = batch(GOLD)
    for wording in (GOLD, LOOKS["snow"].wording):
        asked = replace(asked, prompt=wording)
        *_, last = DiffusionEditor(small).edit(asked, SETTINGS, generator)
        asked = replace(asked, images=last.images, originals=last.images)
    torch.testing.assert_close(steps[-1].images, last.images)


def test_what_no_look_does_is_refused_with_all_of_them(small):
    for sentence in ("", "?!"):
        with pytest.raises(UsageError, match="the sentence is empty: say what should change"):
            small.check(sentence)
    with pytest.raises(UsageError, match=r"small knows the looks bronze, .*vivid"):
        small.check("blorf the quandle")
    with pytest.raises(UsageError, match="two looks, and one pass draws one"):
        small.condition(pictures(1, 16, 16), TWO, torch.Generator())


# ---- the weights that come with gsedit -----------------------------------------------------------


def colorfulness(picture):
    return float((picture.amax(-1) - picture.amin(-1)).mean())


def test_looks_that_a_number_tells_are_followed():
    solid = demo_scene()
    before = solid.trace(ring_cameras(solid, 8, 96)[0], 2).image.float()[None]
    settings = {"steps": 10, "precision": "float32"}
    grey, night, negative = (
        edit(make_editor("small"), before, prompt, **settings)
        for prompt in ("make it black and white", "make it night", "show it as a negative")
    )
    assert colorfulness(grey) < 0.5 * colorfulness(before)
    assert float(night.mean()) < 0.6 * float(before.mean())
    assert torch.corrcoef(torch.stack((before.flatten(), negative.flatten())))[0, 1] < -0.8
