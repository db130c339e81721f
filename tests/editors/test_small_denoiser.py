"""The small editor as a denoiser and as an editor: laws that hold for any weights."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import NETWORK, assert_near
from small_networks import random_network

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.guided import predict_guided
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small.denoiser import DEFAULTS, MID_SIGMA, Small, schedule
from gsedit.editors.small.network import CELL_PIXELS, CHANNELS
from gsedit.editors.small.text import MAX_WORDS
from gsedit.errors import UsageError


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
    assert latents.shape == (2, small.channels, 16 // CELL_PIXELS, 24 // CELL_PIXELS)
    torch.testing.assert_close(small.decode(latents), images)
    torch.testing.assert_close(latents.norm(), (2 * images - 1).norm())


def test_the_schedule_goes_from_hardly_any_noise_to_nothing_else():
    assert schedule().level(0).sigma < 1e-2
    assert schedule().level(500).sigma == pytest.approx(MID_SIGMA, rel=0.01)
    assert schedule().level(999).sigma > 1000


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


def test_words_are_counted_as_they_are_read(small):
    with pytest.raises(UsageError, match=f"26 words and this editor reads {MAX_WORDS}"):
        small.check("black-and-white " * 8 + "it all")


@pytest.mark.parametrize("prompt", ["", "  ", "?!"])
def test_an_instruction_without_words_is_refused(small, prompt):
    with pytest.raises(UsageError, match="the instruction is empty: say what to change"):
        small.check(prompt)


def test_an_instruction_that_is_too_long_is_refused(small):
    with pytest.raises(UsageError, match=f"30 words and this editor reads {MAX_WORDS}"):
        small.check("word " * 30)


def test_an_instruction_that_names_no_look_gets_a_warning():
    small = Small(random_network(), looks=("bronze", "snow"), words=frozenset({"bronze", "snowy"}))
    assert small.advice("Make it SNOWY!") == ""
    assert "no word of 'as a dinosaur' names a look" in small.advice("as a dinosaur")
    assert "it was trained on bronze, snow. For any sentence: --editor pix2pix" in small.advice(
        "zxqv"
    )


def edit(editor, images, prompt="as a bronze statue", seed=0, **settings):
    batch = EditBatch(images=images, originals=images, prompt=prompt)
    sampler = SamplerSettings(**{"steps": 3} | settings)
    *_, last = editor.edit(batch, sampler, torch.Generator().manual_seed(seed))
    return last.images


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_white_pictures_are_edited(small, value):
    edited = edit(DiffusionEditor(small), torch.full((2, 32, 32, 3), value), steps=20)
    assert torch.isfinite(edited).all()
    assert edited.min() >= 0
    assert edited.max() <= 1


def test_sixty_four_views_are_edited_at_once(small):
    edited = edit(DiffusionEditor(small), pictures(64, 16, 16))
    assert edited.shape == (64, 16, 16, 3)
    assert torch.isfinite(edited).all()


@pytest.mark.parametrize("size", [(4, 4), (5, 7), (30, 18)])
def test_odd_sizes_come_back_as_they_were(small, size):
    assert edit(DiffusionEditor(small), pictures(1, *size)).shape == (1, *size, 3)


def test_unknown_words_give_a_finite_edit(small):
    edited = edit(DiffusionEditor(small), pictures(1, 32, 32), "zxqv blorf the wug 日本")
    assert torch.isfinite(edited).all()


@pytest.mark.parametrize("other", [{"guidance_text": 7.5}, {"temperature": 1.0}])
def test_its_defaults_are_used_unless_a_setting_is_given(small, other):
    editor, images = DiffusionEditor(small), pictures(1, 16, 16)
    declared = DEFAULTS._asdict() | {"steps": 3}
    assert torch.equal(edit(editor, images), edit(editor, images, **declared))
    assert not torch.equal(edit(editor, images), edit(editor, images, **other))


def test_what_one_batch_measures_serves_the_next(small):
    """The result of a batch is that of an editor that measures anew."""
    editor, images = DiffusionEditor(small), pictures(2, 16, 16)
    edit(editor, images)
    assert len(editor.known) == 1
    second = edit(editor, images.flip(0))
    assert len(editor.known) == 1
    assert torch.equal(second, edit(DiffusionEditor(small), images.flip(0)))


@pytest.mark.parametrize(("temperature", "differs"), [(0.0, False), (0.5, True), (1.0, True)])
def test_without_starting_noise_the_seed_changes_nothing(small, temperature, differs):
    editor, images = DiffusionEditor(small), pictures(1, 16, 16)
    first, second = (edit(editor, images, seed=s, temperature=temperature) for s in (0, 1))
    assert torch.equal(first, second) is not differs


def test_where_the_subject_is_can_be_told(small):
    """Told nothing new, nothing changes; told otherwise, the edit is another one there."""
    originals = pictures(2, 16, 32)
    generator = torch.Generator().manual_seed(0)
    own = small.condition(originals, "as gold", generator).shown.subject.unflatten(1, (16, 32))
    with_subject = small.capabilities.with_subject
    batch = EditBatch(originals, originals, "as gold")

    def edited(subject):
        *_, last = DiffusionEditor(small).edit(
            replace(batch, subject=subject),
            SamplerSettings(steps=2, precision="float32"),
            torch.Generator().manual_seed(0),
        )
        return last.images

    told = with_subject(own).condition(originals, "as gold", generator).shown.subject
    assert_near(told, own.flatten(1), NETWORK)
    assert_near(edited(own), edited(None), NETWORK)
    left = torch.zeros(2, 16, 32)
    left[:, :, :16] = 1
    assert (edited(left) - edited(1 - left)).abs().max() > 1e-3
