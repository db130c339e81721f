"""The measurements of an edit: agreement between views, held-out edits, names in edit.json."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from PIL import Image

import gsedit
from gsedit import Dataset
from gsedit.datasets.dataset import capture
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import Capabilities, EditProgress, make_editor
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.measures.agreement import WarpComparison
from gsedit.measures.metrics import psnr
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians

SETTINGS = gsedit.EditSettings(
    sampler=SamplerSettings(steps=6),
    update=UpdateSettings(patches=3, patch=32),
    views_per_batch=3,
    batches=2,
)


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def data(scene):
    cameras = ring_cameras(demo_scene(), 24, 64)
    return Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(24)]))


def run(scene, data, settings=SETTINGS):
    return gsedit.edit(
        scene,
        "as bronze",
        editor=make_editor("closed-form"),
        views=data,
        settings=settings,
        strategy=SinglePass(20),
    )


@pytest.fixture(scope="module")
def result(scene, data):
    return run(scene, data)


def test_targets_and_renders_are_compared_at_short_and_long_range(result):
    rows = {(row.pictures, row.range): row for row in result.metrics.evaluation.warp}
    assert ("targets", "short") in rows
    assert ("renders", "short") in rows
    for row in rows.values():
        assert row.pairs > 0
        assert 0.01 <= row.compared <= 1
        assert row.unedited > 0  # resampling alone
        assert row.edited > 0
    # cameras 15 degrees apart share more than cameras farther apart
    if ("renders", "long") in rows:
        assert rows["renders", "short"].compared > rows["renders", "long"].compared


def test_pictures_that_are_not_edited_agree_as_the_unedited_scene_does(scene, data):
    class Idle:
        """Gives back what it is given."""

        name, cell, capabilities = "idle", 8, Capabilities()

        def check(self, prompt):
            pass

        def edit(self, batch, settings, generator):
            yield EditProgress(1, 1, batch.originals)

    settings = replace(SETTINGS, update=replace(SETTINGS.update, loss="mse"))
    still = gsedit.edit(
        scene, "x", editor=Idle(), views=data, settings=settings, strategy=SinglePass(1)
    )
    assert still.held_out.edited == ()  # no diffusion model: there is no noise to share
    assert still.metrics.psnr_to_held_out_edits is None
    assert still.metrics.psnr_to_targets > 40
    for row in still.metrics.evaluation.warp:
        assert row.edited == pytest.approx(row.unedited, rel=0.02), row


@pytest.mark.parametrize(("edited", "excess"), [(0.5, 0.4), (0.3, 0.0), (0.0, -0.3)])
def test_excess_is_what_was_added_in_quadrature(edited, excess):
    row = WarpComparison(
        pictures="targets", range="short", pairs=1, compared=0.5, unedited=0.3, edited=edited
    )
    assert row.excess == pytest.approx(excess)


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


def test_the_numbers_to_read_first_are_one_line(result):
    line = result.metrics.describe()
    assert line.startswith(f"changed by {result.metrics.rmse_to_unedited:.3f} RMSE")
    assert "targets differ between near views by 0." in line
    assert " dB to edits of held-out views, " in line
    assert line.endswith(" dB to such edits made alone")
    assert "\n" not in line


def test_measuring_does_not_change_the_result(scene, data, result):
    without = run(scene, data, replace(SETTINGS, held_out_edits=0))
    assert torch.equal(without.scene.sh, result.scene.sh)
    assert without.metrics.psnr_to_ground_truth == result.metrics.psnr_to_ground_truth
    with pytest.raises(UsageError, match="held-out edits"):
        replace(SETTINGS, held_out_edits=-1)


def test_the_folder_holds_the_numbers_and_shows_the_held_out_cameras(result, tmp_path):
    gsedit.write_edit(tmp_path / "out", result)
    measured = json.loads((tmp_path / "out" / "edit.json").read_text())["measured"]
    assert measured["psnr_to_targets"]["edited"]["value"] == pytest.approx(
        result.metrics.psnr_to_targets
    )
    for name in ("warp_targets_short", "warp_renders_short"):
        assert {"pairs", "compared", "unedited", "edited", "excess"} < set(measured[name])
    numbers = [each for name in measured if isinstance(each := measured[name], dict)]
    told = [each if "against" in each else next(iter(each.values())) for each in numbers]
    assert all(each["against"] for each in told)
    sheet = Image.open(tmp_path / "out" / "before_after.png")
    assert sheet.width > 8 * 128  # six edited views and two held-out ones, enlarged


def test_without_held_out_views_nothing_is_held_out(scene, data):
    settings = replace(SETTINGS, views_per_batch=1, batches=1)
    alone = run(scene, Dataset(data.views[:1]), settings)
    assert alone.held_out.originals == ()
    assert alone.metrics.evaluation.warp == ()
