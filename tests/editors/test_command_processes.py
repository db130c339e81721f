"""A program never outlives its caller, in Python and from the command line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from command_line import gsedit
from programs import APART, CHILD, INVERT, batch, ended, leftovers, needs_proc, run

from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.errors import GseditError
from gsedit.formats.scenes import save


@needs_proc
def test_a_program_that_takes_too_long_is_ended_with_its_children(program, tmp_path):
    pids = tmp_path / "pids"
    editor = program(CHILD.format(pids=str(pids)), timeout=1.0)
    with pytest.raises(
        GseditError, match=r"stopped after 1 s: raise it by --set timeout.*0 of 2 pictures"
    ):
        run(editor)
    assert ended([int(pid) for pid in pids.read_text().split()])


@needs_proc
@pytest.mark.parametrize("how", ["close", "interrupt"])
def test_leaving_early_ends_the_program_and_its_children(program, tmp_path, how, monkeypatch):
    pids = tmp_path / "pids"
    first = INVERT + "    break\n"
    steps = program(first + CHILD.format(pids=str(pids))).edit(batch(), APART, torch.Generator())
    assert next(steps).step == 1
    while not pids.exists() or not pids.read_text().endswith("\n"):
        time.sleep(0.05)
    if how == "close":
        steps.close()
    else:
        monkeypatch.setattr(
            "gsedit.paper.editors.command.wait", lambda _: signal.default_int_handler(2, None)
        )
        with pytest.raises(KeyboardInterrupt):
            next(steps)
    assert ended([int(pid) for pid in pids.read_text().split()])
    assert [p.parent.name for p in leftovers(tmp_path)] == ["input", "input", "output"]


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "bear.ply"
    save(surface_gaussians(demo_scene(), 1000, torch.Generator().manual_seed(0)), path)
    return path


def edit_words(scene: Path, out: Path, command: str) -> list[str]:
    return [
        "edit", str(scene), "fade $(it) \"now\"", "-o", str(out), "--editor", "command",
        "--run", command, "--size", "48", "--views", "2", "--batches", "2", "--set", "coverage=1",
        "--set", "update_steps=4", "--set", "patch=16",
    ]  # fmt: skip


def test_an_edit_with_a_program_and_one_that_fails_in_the_second_round(program, scene, tmp_path):
    out = tmp_path / "out"
    good = gsedit(*edit_words(scene, out, program(INVERT).run))
    assert good.exit_code == 0, good.stderr
    assert (out / "before_after.png").exists()
    assert not (out / "command").exists()

    memory = tmp_path / "ran before"
    once = f"from pathlib import Path as P\nimport sys\nif P({str(memory)!r}).exists():\n"
    once += f"    sys.exit('no memory left')\nP({str(memory)!r}).touch()\n"
    bad = gsedit(*edit_words(scene, out, program(once + INVERT).run), "-f")
    assert bad.exit_code == 1
    assert "ended with code 1; it said: no memory left." in bad.stderr
    assert "last complete checkpoint" in bad.stderr
    assert "Traceback" not in bad.stderr
    assert (out / "checkpoint.safetensors").exists()  # of the first round
    assert len(list((out / "command").rglob("input/*.png"))) == 2


@needs_proc
def test_ctrl_c_ends_the_program_and_says_what_remains(program, scene, tmp_path):
    pids = tmp_path / "pids"
    command = program(CHILD.format(pids=str(pids))).run
    words = edit_words(scene, tmp_path / "out", command)
    code = "import sys, signal as s; s.signal(s.SIGINT, s.default_int_handler)\n"
    code += f"from gsedit_cli.main import main; sys.argv[1:] = {words!r}; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, env=os.environ
    )
    while not pids.exists() or not pids.read_text().endswith("\n"):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    stderr = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "interrupted; no checkpoint was complete yet" in stderr
    assert ended([int(pid) for pid in pids.read_text().split()])
