"""`python -m research.renderer`: the files it leaves, and its errors."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from bad_files import ply_bytes, scene_table
from benchmarks import SameProcess, count_near, rgb
from research import command
from research.renderer import __main__ as main
from research.renderer import plots, sweep, workloads
from research.renderer.measurements import read_measurements


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


def measure(monkeypatch, *words: object) -> int:
    """Exit code of the command with these words."""
    monkeypatch.setattr(sys, "argv", ["renderer", *(str(word) for word in words)])
    with pytest.raises(SystemExit) as ended:
        command.run(main.renderer)
    return ended.value.code


@pytest.mark.usefixtures("alone")
def test_a_sweep_leaves_its_folder_and_compares_with_an_earlier_one(
    scene, tmp_path, monkeypatch, capsys
):
    out = tmp_path / "out"
    quick = (scene, "-o", out, "--quick", "--runs", 1)
    assert measure(monkeypatch, *quick, "--knobs", "stop,tile") == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out / 'bench.md'}\n"
    assert "the garden is left out" in printed.err
    rows = read_measurements(out / "bench.jsonl")
    assert [row.label for row in rows] == ["default", "stop 0", "stop 0.01", "tile 4", "tile 32"]
    assert {row.scene for row in rows} == {"scene, 1 in 8"}
    assert "| tile 4 |" in (out / "bench.md").read_text()
    for name in ("image_error.png", "gradient_error.png"):
        assert count_near(rgb(out / name), plots.STYLES["stop"][0]) > 50
    again = (*quick, "--knobs", "tile", "--compare", out / "bench.jsonl")
    assert measure(monkeypatch, *again) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2 + 3 + 1
    assert len(read_measurements(out / "bench.jsonl")) == 3


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["{scene}", "--knobs", "speed"], 2, "no knob 'speed'"),
        (["{broken}"], 3, "broken.ply"),
        (["{scene}", "--points", "{broken}"], 3, "not the garden's points"),
        (["{scene}", "--compare", "{broken}"], 3, "not a measurement"),
        ([], 2, "nothing to measure"),
    ],
)
def test_what_cannot_be_measured_is_one_line(
    scene, tmp_path, monkeypatch, capsys, words, code, message
):
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat\n")
    paths = {"scene": scene, "broken": tmp_path / "broken.ply"}
    given = [word.format(**paths) for word in words]
    assert measure(monkeypatch, *given, "-o", tmp_path / "out") == code
    printed = capsys.readouterr()
    assert message in printed.err.splitlines()[-1]
    assert printed.out == ""
    assert not (tmp_path / "out").exists()
