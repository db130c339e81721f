"""`gsedit edit --editor auto`: exact routes where they do, today's pipeline where they do not."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import files, gsedit, one_line

from gsedit import load
from gsedit.words.instruction import Change, Instruction

BRIGHTER = Change("scene", "tone", "brightness", None, 0.2, "tone")
PAINT = Change("subject", "paint", "teal", "#029386", None, "paint")


@pytest.fixture
def reads(monkeypatch):
    """A reader of sentences that says what it is told to."""

    def tell(*changes: Change, known: bool = True, why: str = "") -> None:
        read = lambda text, names=(): Instruction(text, known, why, changes)  # noqa: E731
        monkeypatch.setattr("gsedit.words.read.read_instruction", read)

    return tell


def test_a_tone_is_done_without_an_editor(reads, scene, photos, tmp_path):
    reads(BRIGHTER)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it 20 % brighter", "--data", photos, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert "the whole scene 20 % brighter" in result.stderr
    names = {path.relative_to(out).as_posix() for path in files(out)}
    assert names == {
        "scene.ply", "region.npy", "before_after.png", "edit.json", "cameras.json", "views.json",
    }  # fmt: skip
    record = json.loads((out / "edit.json").read_text())
    assert record["route"] == "tone"
    assert record["understood"]["changes"][0]["name"] == "brightness"
    assert {"read", "change", "measure", "total"} <= record["timings"].keys()
    before, after = load(scene), load(out / "scene.ply")
    assert after.sh[:, 1:].numpy() == pytest.approx(1.2 * before.sh[:, 1:].numpy(), abs=1e-5)


def test_a_region_is_where_it_is_done(reads, scene, photos, tmp_path):
    reads(PAINT)
    flags = np.array([True, False, True, False, False])
    np.save(tmp_path / "some.npy", flags)
    out, region = tmp_path / "out", tmp_path / "some.npy"
    words = ("edit", scene, "paint it teal", "--data", photos, "--region", region, "-o", out)
    result = gsedit(*words)
    assert result.exit_code == 0, result.stderr
    assert (np.load(out / "region.npy") == flags).all()
    changed = (load(out / "scene.ply").sh != load(scene).sh).any(-1).any(-1)
    assert (changed.numpy() == flags).all()


def test_a_refused_sentence_writes_nothing(reads, scene, photos, tmp_path):
    reads(known=False, why="it says what must not be: say what should be")
    result = gsedit("edit", scene, "not red", "--data", photos, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert "say what should be" in result.stderr
    assert one_line(result.stderr)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [("--editor", "small"), ("--batches", 1)])
def test_an_option_of_the_2d_editor_asks_for_it(reads, monkeypatch, scene, photos, tmp_path, more):
    reads(BRIGHTER)
    asked = []
    monkeypatch.setattr("gsedit_cli.verbs.edit.run_pipeline", lambda *given: asked.append(given))
    result = gsedit("edit", scene, "brighter", "--data", photos, "-o", tmp_path / "out", *more)
    assert result.exit_code == 0, result.stderr
    assert len(asked) == 1


def test_a_look_goes_to_the_2d_editor(reads, monkeypatch, scene, photos, tmp_path):
    reads(BRIGHTER, Change("scene", "look", "snow", None, None, "small"))
    asked = []
    monkeypatch.setattr("gsedit_cli.verbs.edit.run_pipeline", lambda *given: asked.append(given))
    gsedit("edit", scene, "brighter and snow", "--data", photos, "-o", tmp_path / "out")
    assert len(asked) == 1


def test_a_route_is_explained_without_an_edit(scene, photos, tmp_path):
    out = tmp_path / "out"
    result = gsedit("edit", scene, "20% brighter", "--data", photos, "-o", out, "--explain")
    assert result.exit_code == 0
    assert "done on the Gaussians, no view is edited" in result.stderr
    assert not out.exists()


def test_a_folder_of_others_is_not_replaced(scene, photos, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "scene.ply").write_bytes(b"mine")
    for more in ((), ("--resume",)):
        words = ("edit", scene, "20% brighter", "--data", photos, "-o", out, *more)
        assert gsedit(*words).exit_code == 2
        assert (out / "scene.ply").read_bytes() == b"mine"
