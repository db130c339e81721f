"""Any number of ranks gives what one rank gives; a rank that ends, ends the run with its name."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import rank_worker
import torch
from gsedit_cli.core import ranks as command

from gsedit.datasets.cameras_json import write_beside
from gsedit.formats.scenes import save
from gsedit.runs import ranks
from gsedit.runs.ranks import ALONE, join, variables_of
from gsedit.runs.state import load_state

TESTS = Path(__file__).parent
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def alone():
    return rank_worker.everything(ALONE)


@pytest.fixture(scope="module")
def together(tmp_path_factory):
    """Results that each of two ranks computes."""
    out = tmp_path_factory.mktemp("ranks") / "found"
    processes = [
        subprocess.Popen(
            [sys.executable, str(TESTS / "rank_worker.py"), str(out)],
            env={**ENVIRONMENT, **variables_of(rank, 2, out.parent)},
        )
        for rank in range(2)
    ]
    assert [process.wait(120) for process in processes] == [0, 0]
    return [torch.load(f"{out}.{rank}", weights_only=True) for rank in range(2)]


def test_one_rank_sends_nothing():
    assert join() is ALONE
    primitives = rank_worker.run_primitives(ALONE)
    assert primitives["sum"].tolist() == [1, 1]
    assert not primitives["differs"]


def test_rows_are_shared_out_and_sums_are_over_all(alone, together):
    for found in (each["primitives"] for each in together):
        for name in ("rows", "one", "none"):
            assert torch.equal(found[name], alone["primitives"][name])
        assert found["sum"].tolist() == [3, 3]
        assert found["first"]["rank"] == 0
        assert torch.equal(found["first"]["x"], alone["primitives"]["first"]["x"])
        assert "the number of rank 1 differs from that of rank 0" in found["differs"]


@pytest.mark.parametrize("case", ["edit", "one view", "spray"])
def test_an_edit_on_two_ranks_is_that_of_one(alone, together, case):
    one = alone[case]
    for found in (each[case] for each in together):
        assert found["work"] == one["work"]
        assert found["losses"] == pytest.approx(one["losses"], rel=1e-3)
        for name, tolerance in (("targets", 1e-5), ("finals", 1e-4)):
            assert (found[name] - one[name]).abs().max() < tolerance, name
    for name in ("sh", "opacities", "targets"):
        assert torch.equal(together[0][case][name], together[1][case][name])


def test_a_fit_on_two_ranks_is_that_of_one_with_the_same_batch(alone, together):
    one = alone["fit"]
    for found in (each["fit"] for each in together):
        assert len(found["means"]) == len(one["means"])
        assert found["psnr"] == pytest.approx(one["psnr"], abs=0.01)
        assert found["losses"] == pytest.approx(one["losses"], rel=1e-3)
        assert (found["means"] - one["means"]).abs().max() < 1e-5
    assert torch.equal(together[0]["fit"]["means"], together[1]["fit"]["means"])


def test_the_clock_of_rank_0_ends_a_fit(together):
    assert together[0]["timed"] == together[1]["timed"] > 0


DIES = """
import os, signal, threading, time
from pathlib import Path

def die():
    while not Path({checkpoint!r}).exists():
        time.sleep(0.02)
    os.kill(os.getpid(), signal.{signal})

if os.environ.get("RANK") == "1":
    threading.Thread(target=die, daemon=True).start()
"""


@pytest.mark.parametrize(
    ("killed_by", "said"),
    [("SIGKILL", "rank 1 of 2 ended without a word"), ("SIGINT", "rank 1 of 2 was interrupted")],
)
def test_a_rank_that_ends_ends_the_edit_with_its_name_and_the_checkpoint(tmp_path, killed_by, said):
    scene, data = rank_worker.captured()
    save(scene, tmp_path / "scene.ply")
    write_beside(tmp_path / "scene.ply", data.views)
    out = tmp_path / "out"
    checkpoint = out / "checkpoint.safetensors"
    (tmp_path / "sitecustomize.py").write_text(
        DIES.format(checkpoint=str(checkpoint), signal=killed_by)
    )
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    edit = f"-m gsedit_cli edit {tmp_path / 'scene.ply'} gold --region all --size 32 -o {out}"
    options = "--views 1 --batches 1 --loss mse+gram --set update_steps=3000 --steps 2"
    options += " --checkpoint-every 0"
    ended = subprocess.run(
        [*torchrun, *edit.split(), *options.split()],
        env={**ENVIRONMENT, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode
    lines = [line for line in ended.stderr.splitlines() if line.startswith("gsedit: ")]
    assert f"the last complete checkpoint is {checkpoint}" in " ".join(lines)
    assert said in lines[-1]
    assert load_state(checkpoint).tensors


class Store(dict):
    """A store that ranks share, which the network can cut off."""

    cut = False

    def check(self, keys):
        if self.cut:
            raise RuntimeError("no connection")
        return all(key in self for key in keys)

    def set(self, key, value):
        self[key] = value.encode()

    def get(self, key):
        return self[key]


def test_torchrun_may_ask_a_rank_to_end_that_is_about_to(monkeypatch):
    class Asked(Store):
        def set(self, key, value):
            os.kill(os.getpid(), signal.SIGTERM)
            super().set(key, value)

    monkeypatch.setattr(ranks, "ANSWER_SECONDS", 0.1)
    monkeypatch.setattr(command, "joined", lambda: True)
    monkeypatch.setattr(command, "ranks", lambda: ranks.Ranks(0, 2, store=Asked()))
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        ends = command.cause(ranks.LostRankError("another rank ended"))
    finally:
        signal.signal(signal.SIGTERM, before)
    assert str(ends) == "rank 1 of 2 ended without a word: killed, out of memory, or cut off"


@pytest.mark.parametrize(
    ("said", "blamed"),
    [
        ({0: "", 1: "asked to end", 3: "interrupted"}, "rank 3 of 4 was interrupted"),
        ({0: "", 1: "asked to end", 3: "asked to end"}, "the ranks were asked to end"),
        ({0: "", 1: "asked to end", 3: ""}, "rank 1 of 4 was asked to end"),
        ({0: "", 1: "asked to end", 3: None}, "rank 3 of 4 ended without a word"),
        ({1: "interrupted", 2: "no memory", 3: ""}, "rank 2 of 4 failed: no memory"),
        ({1: "no memory", 3: None}, "rank 1 of 4 failed: no memory"),  # rank 3 may be busy
        ({1: "interrupted", 3: None}, "rank 1 of 4 was interrupted"),
        ({0: "", 1: ""}, ""),
    ],
)
def test_the_rank_that_ended_the_others_is_named(monkeypatch, said, blamed):
    monkeypatch.setattr(command, "joined", lambda: True)
    monkeypatch.setattr(ranks.Ranks, "ends", lambda here: said)
    monkeypatch.setattr(command, "ranks", lambda: ranks.Ranks(2, 4, store=Store()))
    before = signal.getsignal(signal.SIGTERM)
    lost = ranks.LostRankError("another rank ended")
    ends = command.cause(lost)
    signal.signal(signal.SIGTERM, before)
    assert ends is lost if not blamed else str(ends).startswith(blamed)


@pytest.mark.parametrize("rank", [0, 1])
@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize("error", [ranks.LostRankError("another rank ended"), OSError("disk full")])
def test_where_torchrun_is_gone_no_rank_is_blamed(monkeypatch, capsys, rank, is_known, error):
    """Each machine says why it ends."""
    store = Store()
    store.cut = True
    gone = ranks.Pulse(store, rank, 4)
    gone.is_store_lost = is_known
    monkeypatch.setattr(command, "joined", lambda: True)
    monkeypatch.setattr(command, "ranks", lambda: ranks.Ranks(rank, 4, store=store, pulse=gone))
    monkeypatch.setenv("LOCAL_RANK", "0")
    before = signal.getsignal(signal.SIGTERM)
    ends = command.cause(error)
    signal.signal(signal.SIGTERM, before)
    why = "disk full" if isinstance(error, OSError) else "torchrun does not answer"
    assert str(ends).startswith(why)
    says = rank and (is_known or isinstance(error, ranks.LostRankError))  # else rank 0 may ask
    assert (f"rank 1 of 4: {why}" in capsys.readouterr().err) == bool(says)


@pytest.mark.parametrize("what", ["nothing", "silent", "ended", "cut"])
def test_a_pulse_finds_a_rank_that_is_gone(monkeypatch, what):
    monkeypatch.setattr(ranks, "TICK_SECONDS", 0.002)
    store = Store()
    here, other = (ranks.Pulse(store, rank, 2) for rank in range(2))
    here.start()
    if what != "silent":
        other.start()
    if what == "ended":
        store.set(ranks.ENDED, "")
    store.cut = what == "cut"
    here.join(0.3 if what == "nothing" else 20)
    said = {"nothing": "", "silent": "rank 1 gave no sign", "ended": "another rank", "cut": "torch"}
    assert here.lost.startswith(said[what])
    assert bool(here.lost) == (what != "nothing")
    assert here.is_store_lost == (what == "cut")
    for each in (here, other):
        each.stop() if each.is_alive() else None


def test_a_pulse_that_hangs_in_a_question_to_the_store_counts_as_cut_off(monkeypatch):
    monkeypatch.setattr(ranks, "TICK_SECONDS", 0.01)
    store, hangs = Store(), threading.Event()
    store.check = lambda keys: hangs.wait(60)
    here = ranks.Pulse(store, 0, 2)
    here.start()
    assert not any(here.look() for _ in range(1000))  # as often as one likes
    began = time.monotonic()
    while not here.look() and time.monotonic() - began < 20:
        time.sleep(0.0005)
    hangs.set()
    here.stop()
    assert here.lost.startswith("torchrun does not answer")
    assert here.is_store_lost
