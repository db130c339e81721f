"""`small` as a denoiser and as an editor, with any weights and with those that come with gsedit."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest
import torch
from closeness import NETWORK, assert_near
from safetensors import safe_open
from small_networks import random_network

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.guided import predict_guided
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch, make_editor
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small import WEIGHTS
from gsedit.editors.small.editor import (
    DEFAULTS,
    Small,
    SmallEditor,
    load_small,
)
from gsedit.editors.small.network import CELL_PIXELS, CHANNELS
from gsedit.errors import InputError, UsageError
from gsedit.synthetic import demo_scene, ring_cameras
from gsedit.words.looks import LOOKS

CARD = WEIGHTS.with_name("MODEL_CARD.md").read_text(encoding="utf-8")
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


@pytest.mark.parametrize(
    "need", [Need(), Need(True, False, False), Need(False, True, True), Need(True, True, False)]
)
def test_only_the_branches_in_need_are_predicted(small, need):
    originals = pictures(3, 16, 16)
    condition = small.condition(originals, "make it snow", torch.Generator())
    x = noise(3, CHANNELS, 4, 4)
    every = small.branches(x, 500.0, condition, Need())
    some = small.branches(x, 500.0, condition, need)
    for wanted, expected, predicted in zip(need, every, some):
        assert (predicted is not None) == wanted
        if predicted is not None:
            assert_near(predicted, expected, NETWORK)


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


@pytest.mark.parametrize("other", [{"guidance_text": 7.5}, {"temperature": 1.0}])
def test_its_defaults_are_used_unless_a_setting_is_given(small, other):
    editor, images = DiffusionEditor(small), pictures(1, 16, 16)
    declared = DEFAULTS._asdict() | {"steps": 3}
    assert torch.equal(edit(editor, images), edit(editor, images, **declared))
    assert not torch.equal(edit(editor, images), edit(editor, images, **other))


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


def test_anchored_views_stay_as_they_are_in_both_passes(small):
    asked = batch(TWO, views=3)
    finished = torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(5))
    images = torch.stack((asked.images[0], asked.images[1], finished))
    asked = replace(asked, images=images, anchored=torch.tensor([False, False, True]))
    *_, last = run(SmallEditor(small), asked)
    assert torch.equal(last.images[2], finished)
    assert not torch.equal(last.images[:2], images[:2])


def test_what_no_look_does_is_refused_with_all_of_them(small):
    for sentence in ("", "?!"):
        with pytest.raises(UsageError, match="the sentence is empty: say what should change"):
            small.check(sentence)
    with pytest.raises(UsageError, match=r"small knows the looks bronze, .*vivid"):
        small.check("blorf the quandle")
    with pytest.raises(UsageError, match="two looks, and one pass draws one"):
        small.condition(pictures(1, 16, 16), TWO, torch.Generator())


def test_a_broken_file_is_named(tmp_path):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(b"not weights at all")
    with pytest.raises(InputError, match=r"broken\.safetensors does not hold .*install it again"):
        load_small(path)


# ---- the weights that come with gsedit -----------------------------------------------------------


def test_the_card_states_how_they_were_made():
    small = load_small()
    weights = sum(value.numel() for value in small.network.state_dict().values())
    assert f"{weights / 1e6:.1f} M weights" in CARD
    assert f"{WEIGHTS.stat().st_size / 1e6:.1f} MB" in CARD
    s_T, s_I, temperature, *_ = DEFAULTS
    assert f"s_T {s_T:g}, s_I {s_I:g}, starting noise of {temperature:g}" in CARD
    sizes = [int(size) for size in re.findall(r"steps of \d+ at (\d+)", CARD)]
    assert small.capabilities.best_size == max(sizes)
    listed = re.sub(r"\W+", " ", CARD.split("## Looks")[1].split("##")[0])
    assert all(name.replace("-", " ") in listed for name in LOOKS)
    with safe_open(WEIGHTS, framework="pt") as file:
        assert json.loads(file.metadata()["looks"]) == list(LOOKS)


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
