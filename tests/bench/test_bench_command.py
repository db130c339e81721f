"""`gsedit bench`: the files it leaves, its errors, interruptions and help."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from math import nan
from pathlib import Path

import pytest
from bad_files import ply_bytes, scene_table
from benchmarks import SameProcess, count_near, render_measurement, rgb
from gsedit_cli import main as cli
from typer.testing import CliRunner

from gsedit.bench.renderer import folders, plots, stability, sweep, targets, workloads
from gsedit.bench.renderer.measurements import RenderMeasurement, read_measurements
from gsedit.bench.renderer.targets import Target
from gsedit.reports.events import Event


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes(scene_table(40)))
    return path


@pytest.fixture
def alone(monkeypatch):
    """No synthetic scenes, no garden: only what is named."""
    monkeypatch.delenv("GSEDIT_GARDEN", raising=False)
    monkeypatch.setattr(workloads, "synthetic", list)
    monkeypatch.setattr(sweep, "Worker", SameProcess)


def gsedit_bench(*words: object):
    return CliRunner().invoke(cli.app, ["bench", *(str(word) for word in words)])


QUICK = ("--quick", "--runs", "1", "--knobs", "stop,tile")


@pytest.mark.usefixtures("alone")
def test_rasterizer_leaves_its_folder(scene, tmp_path):
    out = tmp_path / "out"
    done = gsedit_bench("rasterizer", scene, "-o", out, *QUICK)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out / 'bench.md'}\n"
    assert "the garden is left out" in done.stderr
    rows = read_measurements(out / "bench.jsonl")
    assert [row.label for row in rows] == ["default", "stop 0", "stop 0.01", "tile 4", "tile 32"]
    assert {row.scene for row in rows} == {"scene, 1 in 8"}
    assert "| tile 4 |" in (out / "bench.md").read_text()
    for name in ("image_error.png", "gradient_error.png"):
        assert count_near(rgb(out / name), plots.STYLES["stop"][0]) > 50

    refused = gsedit_bench("rasterizer", scene, "-o", out, *QUICK)
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert "add -f" in refused.stderr

    again = gsedit_bench(
        "rasterizer", scene, "-o", out, *QUICK[:-1], "tile", "-f", "--json", "--compare",
        out / "bench.jsonl",
    )  # fmt: skip
    assert again.exit_code == 0, again.stderr
    lines = [json.loads(line) for line in again.stdout.splitlines()]
    assert {line["type"] for line in lines} == {"event", "row", "result"}
    values = [line["value"] for line in lines if line["type"] == "row"]
    assert values == ["", "4", "32"]
    assert lines[-1]["rows"] == 3
    assert len(lines[-1]["compared"].splitlines()) == 2 + 3
    assert len(read_measurements(out / "bench.jsonl")) == 3


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["{scene}", "--knobs", "speed"], 2, "no knob 'speed'"),
        (["{broken}"], 3, "broken.ply"),
        (["{scene}", "--points", "{broken}"], 3, "not the garden's points"),
        (["{scene}", "--compare", "{broken}"], 3, "not a measurement"),
        (["{scene}", "--runs", "0"], 2, "runs"),
        ([], 2, "nothing to measure"),
    ],
)
def test_what_cannot_be_measured_is_one_line(scene, tmp_path, words, code, message):
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat\n")
    paths = {"scene": scene, "broken": tmp_path / "broken.ply"}
    done = gsedit_bench("rasterizer", *(w.format(**paths) for w in words), "-o", tmp_path / "out")
    assert done.exit_code == code
    assert message in done.stderr.splitlines()[-1]
    assert done.stdout == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("alone")
def test_an_interrupted_sweep_keeps_its_rows(scene, tmp_path, monkeypatch):
    def interrupted(*_) -> Iterator[RenderMeasurement]:
        yield render_measurement()
        yield render_measurement(knob="tile", value="4")
        raise KeyboardInterrupt

    monkeypatch.setattr(folders, "sweep", interrupted)
    done = gsedit_bench("rasterizer", scene, "-o", tmp_path / "out")
    assert done.exit_code == 130
    assert "interrupted; 2 rows are in" in done.stderr.splitlines()[-1]
    assert len(read_measurements(tmp_path / "out" / "bench.jsonl")) == 2


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


@pytest.mark.parametrize("verb", ["rasterizer", "stability", "targets", "sampler"])
def test_help_shows_an_example(verb):
    done = gsedit_bench(verb, "--help")
    assert done.exit_code == 0
    assert f"gsedit bench {verb} " in done.stdout
