"""`gsedit bench`: its table, its record and its exit code."""

from __future__ import annotations

import json
from dataclasses import asdict

from gsedit_cli import main as cli
from typer.testing import CliRunner

from gsedit import Event
from gsedit.bench.renderer import speed


def gsedit_bench(*words: object):
    return CliRunner().invoke(cli.app, ["bench", *(str(word) for word in words)])


def test_a_missed_target_is_printed_and_the_exit_code_is_0(monkeypatch):
    missed = speed.Speed("crop", "torch", 0.1, 8.0, 9.0, 10.0, 1e-7, 1e-5)
    items = [Event("targets", 0.0, 0, 1), missed]
    monkeypatch.setattr(speed, "measure_targets", lambda *_, **__: iter(items))
    done = gsedit_bench()
    assert done.exit_code == 0
    assert "| crop, torch | 10 | 8.0 |" in done.stdout
    record = json.loads(gsedit_bench("--json").stdout.splitlines()[-1])
    assert record["targets"] == [asdict(missed)]
    assert record["reached"] == 0
