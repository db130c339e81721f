"""Three scenes get their decisions; an edit that skips views differs from one that does not."""

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
from gsedit.paper.editors import make_editor
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
        assert each.applies == (each.error is not None)
        assert 0 <= each.saving <= 1


def pictures(scene, exhibit):
    with torch.no_grad():
        drawn = [render(scene, view.camera).color.clamp(0, 1) for view in exhibit.data.views]
    return torch.stack(drawn)


def ratio(words, editor, **settings):
    """The mean difference that skipping views of `soft` makes, over its estimate."""
    exhibit = EXHIBITS["soft"]()
    skipped, whole = (
        edit(exhibit.scene, words, **asked(exhibit, **settings, disable=each) | {"editor": editor})
        for each in ("", "views")
    )
    (decision,) = (each for each in skipped.decisions if each.applies)
    assert "no bound" in decision.describe()
    assert not any(each.applies for each in whole.decisions)
    error = (pictures(skipped.scene, exhibit) - pictures(whole.scene, exhibit)).abs().mean()
    return float(error) / decision.error


def test_skipped_views_cost_about_the_estimate_which_is_no_bound():
    """Fewer pictures decide the colors of Gaussians that are covered, too."""
    apart = SamplerSettings(consensus=False, noise="independent")
    more = {"sampler": apart, "update": UpdateSettings()}
    exact = ratio("swap", Swapped())  # in steps
    assert exact < 1 < ratio("as a jade statue", make_editor("closed-form"), **more) < 2.5


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
