"""`gsedit bench`: the files it leaves, its errors, interruptions and help."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import nan

import pytest
from gsedit_cli import main as cli
from typer.testing import CliRunner

from gsedit import Event
from gsedit.bench import edit
from gsedit.bench.edit import EditPlan
from gsedit.bench.renderer import stability, targets
from gsedit.bench.renderer.targets import Target


def gsedit_bench(*words: object):
    return CliRunner().invoke(cli.app, ["bench", *(str(word) for word in words)])


def test_a_missed_target_is_printed_and_the_exit_code_is_0(monkeypatch):
    missed = Target("fast", "8 Y wall", "9.1 Y wall", False)
    monkeypatch.setattr(
        targets, "measure_targets", lambda *_: iter([Event("targets", 0.0, 0, 1), missed])
    )
    done = gsedit_bench("targets")
    assert done.exit_code == 0
    assert "| fast | 8 Y wall | 9.1 Y wall | **no** |" in done.stdout
    record = json.loads(gsedit_bench("targets", "--json").stdout.splitlines()[-1])
    assert record["targets"] == [
        {"name": "fast", "required": "8 Y wall", "measured": "9.1 Y wall", "reached": False}
    ]
    assert record["reached"] == 0


@dataclass(frozen=True)
class Case:
    """The part of an edge case's measurement that the command needs."""

    name: str
    error: float


def test_stability_writes_its_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(
        stability, "measurements", lambda quick: iter([Case(f"needle, quick {quick}", nan)])
    )
    monkeypatch.setattr(stability, "table", lambda rows: f"{len(rows)} row")
    done = gsedit_bench("stability", "-o", tmp_path / "out", "--quick")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "1 row\n"
    assert (tmp_path / "out" / "stability.md").read_text() == "1 row\n"
    (line,) = (tmp_path / "out" / "stability.jsonl").read_text().splitlines()
    assert json.loads(line) == {"name": "needle, quick True", "error": None}
    assert "needle" in done.stderr
    assert gsedit_bench("stability", "-o", tmp_path / "out").exit_code == 2


def test_edit_writes_a_curve_of_falling_errors(tmp_path, monkeypatch):
    tiny = EditPlan(
        gaussians=300, cameras=9, size=32, patches=1, patch=16, options={"update_steps": 10}
    )
    measure = edit.edit_to_folder
    monkeypatch.setattr(edit, "edit_to_folder", lambda folder, plan: measure(folder, tiny))
    done = gsedit_bench("edit", "-o", tmp_path / "out", "--quick")
    assert done.exit_code == 0, done.stderr
    rows = [json.loads(line) for line in (tmp_path / "out" / "edit.jsonl").read_text().splitlines()]
    assert [row["steps"] for row in rows] == sorted(row["steps"] for row in rows)
    assert min(rows[-1]["errors"]) < 0.95 * min(rows[0]["errors"])
    assert (tmp_path / "out" / "edit.md").read_text().strip() == done.stdout.strip()
    monkeypatch.undo()
    unknown = gsedit_bench("edit", "-o", tmp_path / "2", "--strategy", "none")
    assert unknown.exit_code == 2


def test_interrupted_targets_say_so(tmp_path, monkeypatch):
    def interrupted(**_):
        yield Case("needle", 0.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(stability, "measurements", interrupted)
    done = gsedit_bench("stability", "-o", tmp_path / "out")
    assert done.exit_code == 130
    assert "interrupted; 1 rows are in" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("verb", ["stability", "targets", "edit"])
def test_help_shows_an_example(verb):
    done = gsedit_bench(verb, "--help")
    assert done.exit_code == 0
    assert f"gsedit bench {verb} " in done.stdout
