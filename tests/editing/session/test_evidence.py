"""The measurements of an edit: agreement between views, held-out edits, names in edit.json."""

from dataclasses import replace

import pytest
import torch
from tiny_edits import painted, seen, steps

import gsedit
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import UsageError
from gsedit.measures.formulas import psnr
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditProgress
from gsedit.paper.strategies.single_pass import SinglePass

SETTINGS = gsedit.EditSettings(
    sampler=SamplerSettings(steps=6),
    update=UpdateSettings(patches=3, patch=32),
    views_per_batch=3,
    batches=2,
)


@pytest.fixture(scope="module")
def scene():
    return painted(2000)


@pytest.fixture(scope="module")
def data():
    return seen(2000, 24, 64)


def run(scene, data, settings=SETTINGS):
    return steps(scene, data, settings, SinglePass(20))[-1]


@pytest.fixture(scope="module")
def result(scene, data):
    return run(scene, data)


def test_pictures_that_are_not_edited_agree_as_the_unedited_scene_does(scene, data):
    class Idle:
        """Gives back what it is given."""

        name, cell, capabilities = "idle", 8, Capabilities()

        def check(self, prompt):
            pass

        def edit(self, batch, settings, generator):
            asked.append(len(batch.images))
            yield EditProgress(1, 1, batch.originals)

    asked = []
    settings = replace(SETTINGS, update=replace(SETTINGS.update, loss="mse"))
    *_, still = steps(scene, data, settings, SinglePass(1), Idle(), "x")
    assert still.held_out.edited == ()  # no diffusion model: there is no noise to share
    assert still.metrics.psnr_to_held_out_edits is None
    assert asked[-2:] == [1, 1]  # and yet held-out views are edited, each in a batch of its own
    alone = zip(still.held_out.alone, still.held_out.originals, strict=True)
    assert all(torch.equal(a.image, b.image) for a, b in alone)
    assert still.metrics.psnr_to_edits_alone > 40
    assert "made alone" in still.metrics.describe()
    assert still.metrics.psnr_to_targets > 40
    for row in still.metrics.evaluation.warp:
        assert row.edited == pytest.approx(row.unedited, rel=0.02), row


def test_the_editor_is_asked_for_held_out_views_as_for_targets(result, data):
    """The closed-form editor has a true edit: what it makes of held-out views is near that."""
    held_out = result.held_out
    names = {view.name for view in data.views[::8]}
    assert len(held_out.edited) == len(held_out.finals) == len(held_out.originals) == 2
    assert {view.name for view in held_out.finals} < names
    assert not names & {view.name for view in result.targets}
    quality = result.metrics
    assert quality.psnr_to_held_out_edits == pytest.approx(
        sum(psnr(a.image, b.image) for a, b in zip(held_out.finals, held_out.edited)) / 2
    )
    changed = [psnr(a.image, b.image) for a, b in zip(held_out.originals, held_out.edited)]
    assert quality.psnr_to_held_out_edits > sum(changed) / 2 + 2


def test_held_out_views_are_asked_for_once_more_without_the_targets(result):
    """The closed-form editor errs by its noise: pictures that share none are farther from it."""
    held_out, quality = result.held_out, result.metrics
    assert [view.name for view in held_out.alone] == [view.name for view in held_out.edited]
    for tied, alone in zip(held_out.edited, held_out.alone):
        assert not torch.equal(tied.image, alone.image)
    assert quality.psnr_to_edits_alone == pytest.approx(
        sum(psnr(a.image, b.image) for a, b in zip(held_out.finals, held_out.alone)) / 2
    )
    assert quality.psnr_to_edits_alone < quality.psnr_to_held_out_edits - 1


def test_measuring_does_not_change_the_result(scene, data, result):
    without = run(scene, data, replace(SETTINGS, held_out_edits=0))
    assert torch.equal(without.scene.sh, result.scene.sh)
    assert without.metrics.psnr_to_ground_truth == result.metrics.psnr_to_ground_truth
    with pytest.raises(UsageError, match="held-out edits"):
        replace(SETTINGS, held_out_edits=-1)
