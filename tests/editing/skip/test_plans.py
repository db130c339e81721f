"""Three scenes get three sets of decisions; an edit with a decision differs from the same edit
without it by less than the decision's bound. --junitxml FILE records the differences."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from command_line import gsedit
from three_scenes import EXHIBITS, SIZE, Swapped

from gsedit import EditSettings, edit
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.editing.edit import plan_edit
from gsedit.formats.scenes import save
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.skips import DECISIONS
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.cameras_json import write_cameras
from rasterizer import render

QUICK = EditSettings(
    sampler=SamplerSettings(steps=2),
    update=UpdateSettings(loss="mse+gram", patches=2, patch=24),
    views_per_batch=2,
    batches=3,
    held_out_edits=0,
)
PLANS = {"ball": set(), "two": set(), "soft": {"views"}}


def asked(exhibit, **settings):
    return {
        "editor": Swapped(),
        "views": exhibit.data,
        "settings": replace(QUICK, region=exhibit.region, **settings),
        "strategy": SinglePass(4),
        "generator": torch.Generator().manual_seed(0),
    }


@pytest.mark.parametrize("name", EXHIBITS)
def test_each_scene_has_its_decisions(name):
    exhibit = EXHIBITS[name]()
    decisions = plan_edit(exhibit.scene, "swap", **asked(exhibit)).decisions
    assert tuple(each.name for each in decisions) == DECISIONS
    assert {each.name for each in decisions if each.applies} == PLANS[name]
    for each in decisions:
        assert each.applies == (each.bound is not None)
        assert 0 <= each.saving <= 1


def pictures(scene, exhibit):
    with torch.no_grad():
        drawn = [render(scene, view.camera).color.clamp(0, 1) for view in exhibit.data.views]
    return torch.stack(drawn)


@pytest.mark.parametrize("name", EXHIBITS)
def test_an_edit_differs_by_less_than_the_bound(name, record_property):
    exhibit = EXHIBITS[name]()
    planned = edit(exhibit.scene, "swap", **asked(exhibit))
    assert planned.scene.sh.shape == exhibit.scene.sh.shape
    taken = {each.name: each for each in planned.decisions if each.applies}
    for each in taken:
        done = edit(exhibit.scene, "swap", **asked(exhibit, disable=each))
        assert not next(d for d in done.decisions if d.name == each).applies
        a, b = (pictures(result.scene, exhibit) for result in (planned, done))
        error = float((a - b).abs().mean())  # the bound is a mean
        record_property(f"{name} {each}", f"{error:.2g}, bound {taken[each].bound}")
        assert error <= taken[each].bound, each
    whole = edit(exhibit.scene, "swap", **asked(exhibit, disable="all"))
    assert not any(each.applies for each in whole.decisions)
    assert torch.equal(whole.scene.means, exhibit.scene.means)
    decibels = [each.metrics.psnr_to_ground_truth for each in (planned, whole)]
    record_property(f"{name}: dB to the truth with and without decisions", f"{decibels}")


def test_explain_edits_nothing_and_needs_no_folder(tmp_path):
    exhibit = EXHIBITS["ball"]()
    save(exhibit.scene, tmp_path / "ball.ply")
    write_cameras(exhibit.data.views, tmp_path / "cameras.json")
    words = ("edit", tmp_path / "ball.ply", "as gold", "--editor", "closed-form", "--size", SIZE)
    before = sorted(tmp_path.rglob("*"))
    shown = gsedit(*words, "--explain", "--batches", 1, "--loss", "mse+gram")
    assert shown.exit_code == 0, shown.stderr
    assert "  merging " in shown.stdout
    assert max(map(len, shown.stdout.splitlines())) <= 80
    record = json.loads(gsedit(*words, "--explain", "--json").stdout.splitlines()[-1])
    assert [each["name"] for each in record["decisions"]] == list(DECISIONS)
    assert sorted(tmp_path.rglob("*")) == before
    assert "or add --explain" in gsedit(*words).stderr
