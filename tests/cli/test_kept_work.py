"""Work that ends early is kept and continued, and what was there before stays as it was."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module

import numpy as np
import pytest
import torch
from command_line import EDIT, FIT, answer, ended_early, files, gsedit, names

from gsedit import load, load_dataset
from gsedit.errors import GseditError
from gsedit.run.state import State, load_state, save_state
from gsedit.scene.similarity import similarity_of
from gsedit.views.cameras_json import read_cameras
from gsedit.views.export_frame import NAME, write_dataparser


@pytest.fixture
def edit(place) -> tuple[object, ...]:
    """The words of a short edit into place/out."""
    return ("edit", place / "room.ply", *EDIT, "-o", place / "out")


@pytest.mark.parametrize("end", [RuntimeError("bug"), MemoryError()])
def test_a_fit_that_fails_leaves_a_checkpoint_that_is_a_scene(end, place, tmp_path):
    fit = ("fit", place / "photos", *FIT, "-o", tmp_path / "a.ply")
    with ended_early("fit", end, checkpoints=2):
        assert gsedit(*fit).exit_code == 1
    checkpoint = tmp_path / "a.checkpoint.safetensors"
    assert answer("convert", checkpoint, tmp_path / "seen.ply")["gaussians"] > 100
    assert not (tmp_path / "a.ply").exists()

    good = load_state(checkpoint)
    for name, tensor in (("sh", torch.zeros(1, 1, 3)), ("means", torch.full((3, 3), torch.nan)),
                         ("other", torch.zeros(1))):  # fmt: skip
        tensors = {**good.tensors, f"optimizer.value.{name}": tensor}
        save_state(State(good.record, tensors), checkpoint)
        damaged = gsedit("convert", checkpoint, tmp_path / "b.ply")
        assert damaged.exit_code == 3
        assert f"{checkpoint} is damaged" in damaged.stderr


def test_interrupted_before_the_first_checkpoint_nothing_is_left(place, tmp_path):
    fit = ("fit", place / "photos", *FIT, "-o", tmp_path / "out/a.ply")
    with ended_early("fit", KeyboardInterrupt(), checkpoints=0):
        assert gsedit(*fit).exit_code == 130
    assert not names(tmp_path / "out")
    assert gsedit(*fit, "--resume").exit_code == 0  # begins


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_sigterm_ends_a_real_process_as_ctrl_c_does(place, tmp_path):
    words = ("fit", place / "photos", "--minutes", 5, "--checkpoint-every", 0)
    command = [sys.executable, "-m", "gsedit_cli", *map(str, words), "-o", str(tmp_path / "a.ply")]
    checkpoint = tmp_path / "a.checkpoint.safetensors"
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not checkpoint.exists():
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        told = process.communicate(timeout=60)[1]
    assert process.returncode == 130, told
    assert load_state(checkpoint).within("optimizer")
    assert not (tmp_path / "a.ply").exists()


def test_an_edit_that_stops_leaves_the_earlier_result_as_it_was(edit, place):
    out = place / "out"
    answer(*edit)
    own, stale = out / "targets/mine/own.png", out / "targets/earlier.png"
    own.parent.mkdir()
    for file in (own, stale):
        file.write_bytes(b"mine")
    before, record = files(out), json.loads((out / "edit.json").read_text())
    with ended_early("edit", KeyboardInterrupt()):
        assert gsedit(*edit, "-f").exit_code == 130
    kept = files(out)
    assert {path: kept[path] for path in before} == before
    added = {path.name for path in set(kept) - set(before)}
    assert added == {"checkpoint.safetensors", "metrics.unfinished.jsonl"}
    record["pictures"]["targets"] += ["earlier.png", "../scene.ply", "../../room.ply"]
    (out / "edit.json").write_text(json.dumps(record))
    answer(*edit, "-f")
    assert stale.exists()  # a list that names other files is not followed
    assert own.read_bytes() == b"mine"
    assert (place / "room.ply").exists()
    assert not list(out.glob("*unfinished*"))


def test_of_two_edits_into_one_folder_the_second_is_refused(edit, monkeypatch):
    module = import_module("gsedit.editing.edit")
    first, codes = module.edit_steps, []

    def edit_steps(*words, **options):
        monkeypatch.setattr(module, "edit_steps", first)
        codes.append(gsedit(*edit, *more).exit_code)
        yield from first(*words, **options)

    for more in ((), ("-f",)):
        monkeypatch.setattr(module, "edit_steps", edit_steps)
        answer(*edit, *more)
    assert codes == [2, 2]


def test_an_edit_goes_on_without_the_checkpoint_that_a_full_disk_takes(edit, place, monkeypatch):
    def full(*_):
        raise GseditError("checkpoint cannot be written (No space left on device)")

    monkeypatch.setattr("gsedit.run.state.save_state", full)
    done = gsedit(*edit)
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("No space left") == 1
    assert (place / "out/edit.json").exists()


LEFT = ("metrics.unfinished.jsonl", ".gs-0123-1-abcd.scene.ply", ".gs-lock.checkpoint.safetensors")


@pytest.mark.parametrize("more", [(), ("--resume",)])
def test_a_run_that_kept_nothing_is_repeated_without_force(edit, place, more):
    (place / "out").mkdir()
    for name in LEFT:
        (place / "out" / name).write_text("")
    assert answer(*edit, *more)["folder"] == str(place / "out")


def test_a_program_that_failed_does_not_stop_the_next_edit(scene, tmp_path):
    run = f"{sys.executable} -c 'raise SystemExit(3)' {{input}} {{output}}"
    words = ("as gold", "-o", tmp_path / "out", "--size", 16, "--region", "all")
    for _ in range(2):
        failed = gsedit("edit", scene, *words, "--editor", "command", "--run", run)
        assert failed.exit_code == 1
        assert "it said nothing" in failed.stderr
    assert {each.name for each in (tmp_path / "out").iterdir()} == {
        "command", "metrics.unfinished.jsonl",
    }  # fmt: skip


def test_cameras_beside_a_fit_are_replaced_only_if_asked(place, tmp_path):
    cameras, fit = tmp_path / "a.cameras.json", ("fit", place / "photos", *FIT)
    cameras.write_text("MINE")
    assert gsedit(*fit, "-o", tmp_path / "a.ply").exit_code == 2
    assert cameras.read_text() == "MINE"
    answer(*fit, "-o", tmp_path / "a.ply", "-f")
    assert json.loads(cameras.read_text())


def test_a_fit_from_a_scene_is_in_the_frame_of_that_scene(place, tmp_path):
    turn = np.array([[0, -2.0, 0, 1], [2, 0, 0, 0], [0, 0, 2, 3], [0, 0, 0, 1]])
    change, out = similarity_of(turn), tmp_path / "fit/a.ply"
    write_dataparser(change, place / NAME)
    words = ("--from", place / "room.ply", "--steps", 1, "-o", out)
    answer("fit", place / "photos", *words)
    before = load_dataset(place / "photos").views[1].camera.center
    after = read_cameras(out.with_name("cameras.json"))[1].camera.center
    expected = change.points(before[None].numpy())[0]
    np.testing.assert_allclose(after, expected, atol=1e-6)
    assert out.with_name(NAME).exists()
    assert len(load(out)) == 7000
