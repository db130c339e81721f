"""`gsedit fit`: events, checkpoints, interruption."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from command_line import files, gsedit, one_line, stub_checkpoint, stub_fit, stub_scene
from gsedit_cli.verbs.fit import say_too_short
from scenes import cloud

from gsedit import FitResult, FitSettings, load_dataset
from gsedit.datasets.export_frame import NAME, read_dataparser, write_dataparser
from gsedit.formats.scenes import load, save
from gsedit.runs.state import State, load_state, save_state
from gsedit.scene.similarity import similarity_of


def test_fit_writes_the_scene_and_removes_its_checkpoint(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    out = tmp_path / "scene.ply"
    result = gsedit("fit", photos, "-o", out, "--minutes", 2, "--seed", 7, "--json")
    assert result.exit_code == 0, result.stderr
    event, record = (json.loads(line) for line in result.stdout.splitlines())
    assert event["type"] == "event"
    assert record == {
        "type": "result", "scene": str(out), "gaussians": 3, "psnr": 20.0,
        "steps": 2, "seconds": 2.0, "curve": [[2.0, 20.0]],
    }  # fmt: skip
    assert given["settings"].seconds == 120
    assert given["settings"].steps is None
    assert given["settings"].execution.kernel == "auto"
    assert given["seed"] == 7
    assert len(load(out)) == 3
    assert set(files(tmp_path)) - set(files(photos)) == {out, tmp_path / "cameras.json"}
    assert "gsedit view" in result.stderr


@pytest.mark.parametrize("end", [KeyboardInterrupt(), RuntimeError("bug"), MemoryError()])
def test_an_ended_fit_leaves_its_last_checkpoint_and_says_where(monkeypatch, photos, tmp_path, end):
    stub_fit(monkeypatch, end=end, checkpoints=2)
    out, checkpoint = tmp_path / "scene.ply", tmp_path / "scene.checkpoint.safetensors"
    result = gsedit("fit", photos, "-o", out)
    assert result.exit_code == (130 if isinstance(end, KeyboardInterrupt) else 1)
    assert f"last complete checkpoint is {checkpoint} (step 20)" in result.stderr
    assert "--resume" in result.stderr
    seen = tmp_path / "seen.ply"
    assert gsedit("convert", checkpoint, seen).exit_code == 0
    assert len(load(seen)) == 3
    assert not out.exists()

    stub_fit(monkeypatch)  # a second run does not write over it unasked
    forgotten = gsedit("fit", photos, "-o", out)
    assert forgotten.exit_code == 2
    assert "--resume" in forgotten.stderr
    given = stub_fit(monkeypatch)
    assert gsedit("fit", photos, "-o", out, "--resume").exit_code == 0
    assert set(given["resume"].within("optimizer")) >= {"value.means", "value.sh"}
    assert not checkpoint.exists()


def test_interrupted_before_the_first_checkpoint(monkeypatch, photos, tmp_path):
    stub_fit(monkeypatch, end=KeyboardInterrupt(), checkpoints=0)
    result = gsedit("fit", photos, "-o", tmp_path / "scene.ply")
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1].startswith("gsedit: interrupted; no checkpoint")
    assert set(files(tmp_path)) == set(files(photos))


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_sigterm_ends_a_real_process_as_ctrl_c_does(photos, tmp_path):
    code = (
        "import sys, time\n"
        "from importlib import import_module\n"
        f"sys.path[:0] = {[str(folder) for folder in Path(__file__).parents[:2]]}\n"
        "from command_line import stub_checkpoint, Event\n"
        "def fit_steps(*_, **__):\n"
        "    yield stub_checkpoint(5)\n"
        "    yield Event('fit', 0.2, 5, 10)\n"
        "    time.sleep(60)\n"
        "import_module('gsedit.fitting.fit').fit_steps = fit_steps\n"
        "from gsedit_cli.main import main\n"
        f"sys.argv = ['gsedit', 'fit', {str(photos)!r}, '-o', {str(tmp_path / 's.ply')!r}]\n"
        "main()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    while (line := process.stderr.readline()).startswith("compiling"):  # where none was yet
        pass
    assert line.startswith(("renders with", "no C++ compiler"))
    assert "fit 5/10" in process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    messages = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "(step 5)" in messages
    assert load_state(tmp_path / "s.checkpoint.safetensors").within("optimizer")


@pytest.mark.parametrize(
    ("steps", "seconds", "told"),
    [(10, 30.0, "5"), (10, 840.0, "140"), (10, 5.0, ""), (99, 30.0, "")],
)
def test_a_budget_that_the_photos_use_up_is_told(steps, seconds, told, capsys):
    result = FitResult(cloud()[0], 9.0, steps, seconds, ())
    say_too_short(result, FitSettings(seconds=6.0))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == bool(told)
    needed = f"--minutes {told} or more"
    assert all("6 s are too short" in line and needed in line for line in lines)


def test_a_fit_can_do_without_the_kernel(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    result = gsedit(
        "fit", photos, "-o", tmp_path / "scene.ply", "--minutes", 2, "--kernel", "torch"
    )
    assert result.exit_code == 0, result.stderr
    assert given["settings"].execution.kernel == "torch"
    assert "renders with" not in result.stderr


def test_quality_sets_budget_gaussians_degree_and_size_and_given_options_win(
    monkeypatch, photos, tmp_path
):
    sizes = []
    whole = import_module("gsedit.datasets.load").load_dataset
    monkeypatch.setattr(
        "gsedit.datasets.load.load_dataset",
        lambda path, size: sizes.append(size) or whole(path, size=size),
    )

    def asked(*options):
        given = stub_fit(monkeypatch)
        result = gsedit("fit", photos, "-o", tmp_path / "scene.ply", "-f", *options)
        assert result.exit_code == 0, result.stderr
        settings = given["settings"]
        degree = settings.sh_degree
        return settings.seconds, settings.steps, settings.max_gaussians, degree, sizes.pop()

    assert asked() == asked("--quality", "normal") == (300.0, 14_000, 150_000, 1, 256)
    assert asked("--minutes", 9) == (540.0, None, 150_000, 1, 256)  # time that is given is used
    assert asked("--quality", "draft") == (90.0, None, 120_000, 1, 256)
    assert asked("--quality", "high") == (900.0, None, 300_000, 2, 512)
    own = ("--minutes", 2, "--max-gaussians", 7, "--sh-degree", 0, "--size", 32)
    assert asked("--quality", "high", *own) == (120.0, None, 7, 0, 32)
    assert asked("--quality", "draft", "--steps", 9) == (None, 9, 120_000, 1, 256)
    assert gsedit("fit", photos, "-o", tmp_path / "b.ply", "--quality", "best").exit_code == 2


def test_a_fit_from_a_scene_is_in_the_frame_of_that_scene(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    start, out = tmp_path / "start/scene.ply", tmp_path / "out/scene.ply"
    for each in (start, out):
        each.parent.mkdir()
    save(stub_scene(), start)
    change = similarity_of(np.array([[0, -2.0, 0, 1], [2, 0, 0, 0], [0, 0, 2, 3], [0, 0, 0, 1]]))
    write_dataparser(change, start.with_name(NAME))
    assert gsedit("fit", photos, "-o", out, "--from", start).exit_code == 0
    before, after = load_dataset(photos, size=256).views[1], given["dataset"].views[1]
    expected = change.points(before.camera.center[None].numpy())[0]
    assert after.camera.center.tolist() == pytest.approx(expected.tolist())
    assert np.allclose(read_dataparser(out.with_name(NAME)).matrix, change.matrix)
    assert gsedit("fit", photos, "-o", tmp_path / "own.ply").exit_code == 0
    assert torch.equal(
        given["dataset"].views[1].camera.world_to_camera, before.camera.world_to_camera
    )
    assert not (tmp_path / NAME).exists()


def test_cameras_of_the_scene_are_replaced_only_if_asked(monkeypatch, photos, tmp_path):
    stub_fit(monkeypatch, end=AssertionError("the fit began"))
    cameras, out = tmp_path / "a.cameras.json", tmp_path / "a.ply"
    cameras.write_text("MINE")
    refused = gsedit("fit", photos, "-o", out)
    assert refused.exit_code == 2
    assert f"{cameras} already exists" in refused.stderr
    assert cameras.read_text() == "MINE"
    stub_fit(monkeypatch)
    assert gsedit("fit", photos, "-o", out, "-f").exit_code == 0
    assert json.loads(cameras.read_text())


def test_resume_begins_a_fit_that_kept_nothing(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    result = gsedit("fit", photos, "-o", tmp_path / "a.ply", "--resume")
    assert result.exit_code == 0, result.stderr
    assert "the fit begins" in result.stderr
    assert given["resume"] is None
    assert gsedit("fit", photos, "-o", tmp_path / "a.ply", "--resume").exit_code == 2  # it is there


def test_a_damaged_checkpoint_is_not_converted(photos, tmp_path):
    path = tmp_path / "a.checkpoint.safetensors"
    good = stub_checkpoint(1).state
    for tensors in ({}, {**good.tensors, "optimizer.value.sh": torch.zeros(1, 1, 3)},
                    {**good.tensors, "optimizer.value.means": torch.full((3, 3), torch.nan)},
                    {**good.tensors, "optimizer.value.other": torch.zeros(1)}):  # fmt: skip
        save_state(State({}, tensors), path)
        result = gsedit("convert", path, tmp_path / "seen.ply")
        assert result.exit_code == 3
        assert one_line(result.stderr)
        assert f"{path} is damaged" in result.stderr
