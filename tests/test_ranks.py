"""Any number of ranks gives what one rank gives; a rank that ends, ends the run with its name."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import rank_worker
import torch

from gsedit.formats.scenes import save
from gsedit.run.ranks import ALONE, variables_of
from gsedit.run.state import load_state
from gsedit.views.cameras_json import write_beside

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
    options += " --set checkpoint_seconds=0 --editor closed-form"
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
