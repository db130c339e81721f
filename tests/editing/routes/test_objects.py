"""Changes of objects among the changes of a sentence: whose rows are whose afterwards."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import tiny_edits
import torch
from changes import Known, changed_by

import gsedit
from gsedit.editing.plan import runs_of
from gsedit.paper.settings import EditSettings
from gsedit.scene.outcome import NEW, Outcome
from gsedit.words.read import read_instruction
from rasterizer.scene import Gaussians, concatenate

SUBJECT, RED = slice(0, 200), slice(200, 300)


def flags(rows: slice, count: int = 1000) -> torch.Tensor:
    inside = torch.zeros(count, dtype=torch.bool)
    inside[rows] = True
    return inside


@pytest.fixture(autouse=True)
def operations(monkeypatch):
    """Stand-ins of the operations: their laws are tested where they are."""

    def remove(scene, inside, cameras=(), execution=None):
        rows = torch.cat((torch.nonzero(~inside).flatten(), torch.tensor([NEW])))
        after = concatenate(scene[~inside], scene[:1])
        return Outcome(after, rows, rows == NEW, ("filled",))

    def place(scene, inside, placement, cameras=(), execution=None):
        rows = torch.arange(len(scene))
        if placement.copy:
            new = torch.full((int(inside.sum()),), NEW)
            return Outcome(
                concatenate(scene, scene[inside]),
                torch.cat((rows, new)),
                torch.cat((torch.zeros(len(scene), dtype=torch.bool), new == NEW)),
            )
        means = torch.where(inside[:, None], scene.means * placement.scale, scene.means)
        return Outcome(replace(scene, means=means), rows, inside)

    monkeypatch.setattr("gsedit.change.objects.remove", remove)
    monkeypatch.setattr("gsedit.change.objects.place", place)


def applied(sentence: str, shown: torch.Tensor | None = None):
    cameras = [view.camera for view in tiny_edits.data().views]
    known = {"the red one": flags(RED)}
    return changed_by(sentence, Known(tiny_edits.scene(), flags(SUBJECT), cameras, known), shown)


def repainted(after: Gaussians, rows: torch.Tensor) -> torch.Tensor:
    """Whether the colors of Gaussians differ from those of these rows of the scene before."""
    return (after.sh[:, 0] != tiny_edits.scene().sh[rows, 0]).any(-1)


def test_several_copies_are_made_one_after_the_other():
    change = {"target": "subject", "kind": "object", "name": "copy", "phrase": "the red one",
              "amount": 3, "place": {"side": "left", "of": "the red one"}}  # fmt: skip
    routed = applied(json.dumps({"changes": [change]}))
    assert len(routed.scene) == 1300
    assert (routed.origin[1000:] == NEW).all()


def test_later_changes_find_their_rows_after_a_removal():
    routed = applied("remove the red one and paint the statue black")
    scene = routed.scene
    assert len(scene) == 901
    rows = torch.nonzero(~flags(RED)).flatten()
    changed = repainted(scene[:900], rows)
    assert changed[SUBJECT].all()
    assert not changed[200:].any()
    assert routed.region_before is not None
    assert (routed.region_before.inside == (flags(RED) | flags(SUBJECT))).all()
    assert (routed.region.inside == (flags(SUBJECT, 901) | flags(slice(900, 901), 901))).all()
    assert "filled" in routed.notes


def test_it_is_what_was_named_or_made_last():
    routed = applied("make the red one 100 % larger and paint it black")
    changed = repainted(routed.scene, torch.arange(1000))
    assert (changed == flags(RED)).all()
    assert torch.equal(routed.scene.means[RED], 2 * tiny_edits.scene().means[RED])
    routed = applied("copy the red one and paint the copy black")
    rows = torch.cat((torch.arange(1000), torch.arange(200, 300)))
    assert (repainted(routed.scene, rows) == flags(slice(1000, 1100), 1100)).all()


@pytest.mark.parametrize(
    ("sentence", "done"),
    [
        ("move it to the left, turn it around and make it bigger", [3]),
        ("move it to the left, remove it", [1, 1]), ("make it bigger, make it bigger", [1, 1]),
        ("duplicate it and make it bigger", [2]), ("turn it around and paint it red", [1, 1]),
        ("make it bigger and turn the red one around", [1, 1]),
    ],
)  # fmt: skip
def test_what_places_one_object_is_done_at_once(sentence, done):
    read = read_instruction(sentence, accept_unread=True)
    grouped = list(runs_of(read))
    assert [each for run in grouped for each in run] == list(read.changes)
    assert [len(run) for run in grouped] == done


def test_an_edit_of_objects_from_python_is_written_with_both_regions(tmp_path):
    scene, region = tiny_edits.scene(), tmp_path / "red.npy"
    np.save(region, flags(RED).numpy())
    result = gsedit.edit(
        scene, "remove it", views=tiny_edits.data(), settings=EditSettings(region=str(region))
    )
    gsedit.write_edit(tmp_path / "out", result)
    assert np.load(tmp_path / "out" / "region_before.npy").sum() == 100
    assert len(np.load(tmp_path / "out" / "region.npy")) == len(result.scene) == 901
    record = json.loads((tmp_path / "out" / "edit.json").read_text())
    assert record["route"] == "object"
    assert record["notes"][0] == "filled"
    assert record["objects"] == {
        "gaussians_before": 1000, "changed_or_gone": 100, "changed_or_new": 1,
    }  # fmt: skip
    assert result.metrics.psnr_outside_region is not None
    gsedit.write_edit(
        tmp_path / "out",
        gsedit.edit(scene, "20% brighter", views=tiny_edits.data()),
        overwrite=True,
    )
    assert not (tmp_path / "out" / "region_before.npy").exists()
