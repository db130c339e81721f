"""The folder of an edit from Python: one call, every file, and nothing replaced unasked."""

import json
from dataclasses import replace

import pytest
import torch
from command_line import read_events
from tiny_edits import SETTINGS, data, scene, steps

import gsedit
from gsedit.errors import UsageError
from gsedit.paper.skips import DECISIONS
from gsedit.paper.strategies.single_pass import SinglePass

FILES = {
    "scene.ply", "region.npy", "edit.json", "metrics.jsonl", "before_after.png",
    "targets", "held_out", "held_out_alone",
}  # fmt: skip


@pytest.fixture(scope="module")
def edited():
    """(events and checkpoints, result) of a small edit."""
    settings = replace(SETTINGS, batches=1, held_out_edits=2)
    *events, result = steps(scene(), data(), settings, SinglePass(2))
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
    assert record["settings"]["update"]["patch"] == 32
    truth = record["measured"]["psnr_to_ground_truth"]["held_out"]
    assert truth["value"] == pytest.approx(result.metrics.psnr_to_ground_truth)
    assert truth["views"] == 2
    assert record["view_plan"]["batches"] == [list(batch) for batch in result.view_plan.batches]
    assert [each["name"] for each in record["decisions"]] == list(DECISIONS)
    assert record["edited_views"] == [view.name for view in result.targets]
    assert torch.__version__.startswith(record["versions"]["torch"])


def test_files_are_replaced_only_if_asked(edited, tmp_path):
    _, result = edited
    (tmp_path / "before_after.png").write_text("mine")
    with pytest.raises(UsageError, match=r"before_after\.png"):
        gsedit.write_edit(tmp_path, result)
    assert [path.name for path in tmp_path.iterdir()] == ["before_after.png"]  # nothing is written
    gsedit.write_edit(tmp_path, result, overwrite=True)
    assert {path.name for path in tmp_path.iterdir()} == FILES
