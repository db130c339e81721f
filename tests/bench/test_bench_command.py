"""`gsedit bench`: what it prints, also where a target is missed."""

from __future__ import annotations

import json
from dataclasses import asdict
from math import nan

from command_line import gsedit

from gsedit import Event
from gsedit.bench.renderer import speed, stability


def test_a_missed_target_is_printed_and_the_exit_code_is_0(monkeypatch):
    missed = speed.Speed("crop", "torch", 0.1, 8.0, 9.0, 10.0, 1e-7, 1e-5)
    items = [Event("targets", 0.0, 0, 1), missed]
    monkeypatch.setattr(speed, "measure_targets", lambda *_, **__: iter(items))
    done = gsedit("bench", "targets")
    assert done.exit_code == 0
    assert "| crop, torch | 10 | 8.0 |" in done.stdout
    record = json.loads(gsedit("bench", "targets", "--json").stdout.splitlines()[-1])
    assert record["targets"] == [asdict(missed)]
    assert record["reached"] == 0


def test_stability_prints_its_table(monkeypatch):
    rows = [Event("stability", 0.0, 0, 1, note="needle"), {"name": "needle", "error": nan}]
    monkeypatch.setattr(stability, "measurements", lambda: iter(rows))
    monkeypatch.setattr(stability, "table", lambda rows: f"{len(rows)} row")
    done = gsedit("bench", "stability")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == "1 row\n"
    assert "needle" in done.stderr
    record = json.loads(gsedit("bench", "stability", "--json").stdout.splitlines()[-1])
    assert record["rows"] == [{"name": "needle", "error": None}]
