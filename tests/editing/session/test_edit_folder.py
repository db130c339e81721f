"""The folder of an edit from Python: one call, every file, and nothing replaced unasked."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from command_line import read_events

import gsedit
from gsedit import Dataset
from gsedit.datasets.dataset import capture
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import make_editor
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.paper.evidence import HeldOutViews
from gsedit.paper.skips import DECISIONS
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians

FILES = {
    "scene.ply", "region.npy", "edit.json", "metrics.jsonl", "before_after.png",
    "error_vs_time.png", "targets", "held_out",
    "held_out_alone",
}  # fmt: skip


@pytest.fixture(scope="module")
def edited():
    """(events and checkpoints, result) of a small edit."""
    scene = surface_gaussians(demo_scene(), 500, torch.Generator().manual_seed(0))
    cameras = ring_cameras(demo_scene(), 9, 32)
    settings = gsedit.EditSettings(
        sampler=SamplerSettings(steps=2),
        update=UpdateSettings(patches=1, patch=16),
        views_per_batch=2,
        batches=1,
    )
    *events, result = gsedit.edit_steps(
        scene,
        "as bronze",
        editor=make_editor("closed-form"),
        generator=torch.Generator().manual_seed(0),
        views=Dataset(capture(scene, cameras, [str(i) for i in range(9)])),
        settings=settings,
        strategy=SinglePass(2),
    )
    return events, result


def test_one_call_writes_the_folder_of_the_command(edited, tmp_path):
    events, result = edited
    folder = tmp_path / "new" / "out"
    gsedit.write_edit(folder, result, request={"seed": 0, "scene": folder})
    assert {path.name for path in folder.iterdir()} == FILES
    assert len(gsedit.load(folder / "scene.ply")) == len(result.scene)
    happened = [event for event in events if isinstance(event, gsedit.Event)]
    assert read_events(folder / "metrics.jsonl") == happened
    record = json.loads((folder / "edit.json").read_text())
    assert (record["instruction"], record["seed"]) == ("as bronze", 0)
    assert record["strategy"] == {"name": "single-pass", "settings": {"update_steps": 2}}
    assert record["settings"]["update"]["patch"] == 16
    truth = record["measured"]["psnr_to_ground_truth"]["held_out"]
    assert truth["value"] == pytest.approx(result.metrics.psnr_to_ground_truth)
    assert truth["views"] == 2
    assert record["view_plan"]["batches"] == [list(batch) for batch in result.view_plan.batches]
    assert [each["name"] for each in record["decisions"]] == list(DECISIONS)
    assert record["edited_views"] == [view.name for view in result.targets]
    assert record["versions"]["torch"] == torch.__version__


def test_files_are_replaced_only_if_asked(edited, tmp_path):
    _, result = edited
    (tmp_path / "before_after.png").write_text("mine")
    with pytest.raises(UsageError, match=r"before_after\.png"):
        gsedit.write_edit(tmp_path, result)
    assert [path.name for path in tmp_path.iterdir()] == ["before_after.png"]  # nothing is written
    gsedit.write_edit(tmp_path, result, overwrite=True)
    assert {path.name for path in tmp_path.iterdir()} == FILES


def test_a_notebook_shows_its_pictures_and_numbers(edited):
    result = edited[1]
    html = result._repr_html_()
    assert html is not None
    for text in (result.prompt, f"{len(result.scene):,}", " dB", "data:image/png;base64,"):
        assert text in html
    assert result._repr_png_()[:4] == b"\x89PNG"
    assert len(repr(result)) < 200
    assert replace(result, finals=())._repr_png_() is not None
    bare = replace(result, originals=(), targets=(), finals=())
    assert bare._repr_html_() is not None  # held-out views
    assert replace(bare, held_out=HeldOutViews())._repr_html_() is None
