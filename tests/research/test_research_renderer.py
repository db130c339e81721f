"""`python -m research.renderer`: the files it leaves, and its errors."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from bad_files import ply_bytes, scene_table
from benchmarks import SameProcess
from research import command
from research.renderer import __main__ as main
from research.renderer import sweep, workloads


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
def test_a_sweep_leaves_its_folder(scene, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    quick = (scene, "-o", out, "--quick", "--runs", 1)
    assert measure(monkeypatch, *quick, "--knobs", "stop,tile") == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out / 'bench.md'}\n"
    assert "the garden is left out" in printed.err
    rows = [json.loads(line) for line in (out / "bench.jsonl").read_text().splitlines()]
    found = [(row["knob"], row["value"]) for row in rows]
    assert found == [
        ("default", ""),
        ("stop", "0"),
        ("stop", "0.01"),
        ("tile", "4"),
        ("tile", "32"),
    ]
    assert {row["scene"] for row in rows} == {"scene, 1 in 8"}
    assert "| tile 4 |" in (out / "bench.md").read_text()
    assert (out / "image_error.png").stat().st_size > 5000
    assert measure(monkeypatch, *quick, "--knobs", "tile") == 0
    assert len((out / "bench.jsonl").read_text().splitlines()) == 3


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["{scene}", "--knobs", "speed"], 2, "no knob 'speed'"),
        (["{broken}"], 3, "broken.ply"),
        (["{scene}", "--points", "{broken}"], 3, "not the garden's points"),
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
