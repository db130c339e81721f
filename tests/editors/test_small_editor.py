"""`small` as an editor: one pass a look, and nothing that it does not understand."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from small_networks import random_network

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch, make_editor
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small.denoiser import Small
from gsedit.editors.small.editor import SmallEditor
from gsedit.errors import UsageError
from gsedit.words.looks import LOOKS

SETTINGS = SamplerSettings(steps=2)
TWO = "a golden statue in the snow"


@pytest.fixture(scope="module")
def small() -> Small:
    return Small(random_network(), looks=tuple(LOOKS))


def batch(prompt: str, views: int = 2) -> EditBatch:
    images = torch.rand(views, 16, 16, 3, generator=torch.Generator().manual_seed(0))
    return EditBatch(images, images, prompt)


def run(editor, batch: EditBatch):
    return list(editor.edit(batch, SETTINGS, torch.Generator().manual_seed(0)))


def test_one_look_is_one_pass_in_the_networks_own_wording(small):
    editor = SmallEditor(small)
    assert editor.capabilities.understand("dip it in gold").names == ("gold",)
    ours = run(editor, batch("dip it in gold"))
    plain = run(DiffusionEditor(small), batch(LOOKS["gold"].wording))
    assert [(p.step, p.steps) for p in ours] == [(p.step, p.steps) for p in plain]
    torch.testing.assert_close(ours[-1].images, plain[-1].images)


def test_two_looks_are_two_passes_the_subjects_first(small):
    steps = run(SmallEditor(small), batch(TWO))
    assert [p.step for p in steps] == sorted(p.step for p in steps)
    assert {p.steps for p in steps} == {2 * SETTINGS.steps}
    assert [p.images is not None for p in steps] == [False] * (len(steps) - 1) + [True]
    generator = torch.Generator().manual_seed(0)
    asked = batch(LOOKS["gold"].wording)
    for wording in (LOOKS["gold"].wording, LOOKS["snow"].wording):
        asked = replace(asked, prompt=wording)
        *_, last = DiffusionEditor(small).edit(asked, SETTINGS, generator)
        asked = replace(asked, images=last.images, originals=last.images)
    torch.testing.assert_close(steps[-1].images, last.images)


def test_an_instruction_may_be_about_the_scene(small):
    assert small.capabilities.is_whole("it snows")
    assert small.capabilities.is_whole(TWO)
    assert not small.capabilities.is_whole(LOOKS["gold"].wording)


def test_anchored_views_stay_as_they_are_in_both_passes(small):
    asked = batch(TWO, views=3)
    finished = torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(5))
    images = torch.stack((asked.images[0], asked.images[1], finished))
    asked = replace(asked, images=images, anchored=torch.tensor([False, False, True]))
    *_, last = run(SmallEditor(small), asked)
    assert torch.equal(last.images[2], finished)
    assert not torch.equal(last.images[:2], images[:2])


def test_a_wish_that_no_look_fulfils_is_refused_unless_it_may_guess(small):
    with pytest.raises(UsageError) as caught:
        SmallEditor(small).check("give it a hat")
    for part in ("asks for no look", "gsedit list looks", "--guess", "pix2pix", "--editor command"):
        assert part in str(caught.value)
    guessing = SmallEditor(replace(small, guess=True))
    guessing.check("give it a hat")
    assert "is a guess" in guessing.capabilities.advice("give it a hat")
    assert guessing.capabilities.advice("dip it in gold") == ""
    assert run(guessing, batch("give it a hat"))[-1].images is not None


def test_weights_of_other_looks_read_the_instruction_themselves():
    other = SmallEditor(Small(random_network(), looks=("plaid",)))
    assert other.capabilities.understand is None
    other.check("give it a hat")


def test_the_option_is_smalls_alone():
    assert make_editor("small", guess=True).small.guess
    with pytest.raises(UsageError, match="has no option --guess"):
        make_editor("closed-form", guess=True)
