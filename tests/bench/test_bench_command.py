"""`gsedit bench`: the files it leaves, its errors, interruptions and help."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from math import nan

from gsedit_cli import main as cli
from typer.testing import CliRunner

from gsedit import Event
from gsedit.bench.renderer import speed, stability


def gsedit_bench(*words: object):
    return CliRunner().invoke(cli.app, ["bench", *(str(word) for word in words)])


def test_a_missed_target_is_printed_and_the_exit_code_is_0(monkeypatch):
    missed = speed.Speed("crop", "torch", 0.1, 8.0, 9.0, 10.0, 1e-7, 1e-5)
    items = [Event("targets", 0.0, 0, 1), missed]
    monkeypatch.setattr(speed, "measure_targets", lambda *_, **__: iter(items))
    done = gsedit_bench("targets")
    assert done.exit_code == 0
    assert "| crop, torch | 10 | 8.0 |" in done.stdout
    record = json.loads(gsedit_bench("targets", "--json").stdout.splitlines()[-1])
    assert record["targets"] == [asdict(missed)]
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
