"""Kill an edit (`kill -9`) at random moments, resume it, and compare it with the uninterrupted one.

python examples/kill_and_resume.py out/kills 10
"""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import torch

import gsedit
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.dataset import capture
from gsedit.runs.state import load_state
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians

OPTIONS = (
    "--size 64 --batches 3 --steps 6 --loss mse+gram --update-steps 60 "
    "--checkpoint-every 0.3 --threads 1"
)
SPAN = 5.0
"""Seconds after the first checkpoint in which a kill falls."""
FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")


def start(folder: Path, source: Path, *more: str) -> subprocess.Popen[bytes]:
    words = ["edit", str(source), "as gold", "-o", str(folder), *OPTIONS.split(), *more]
    program = "from gsedit_cli.main import main; main()"
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-c", program, *words]
    return subprocess.Popen(command, stdout=quiet, stderr=quiet)


def difference(ours: Path, theirs: Path) -> float:
    """The largest of any number of the scenes."""
    a, b = (gsedit.load(folder / "scene.ply") for folder in (ours, theirs))
    return max(float((getattr(a, f) - getattr(b, f)).abs().max()) for f in FIELDS)


def main(out: Path, kills: int) -> None:
    """Print for each kill when it was, the step that was resumed from, and the difference."""
    scene = surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))
    source, whole = out / "scene.ply", out / "whole"
    gsedit.save(scene, source, overwrite=True)
    names = [f"{i:02d}" for i in range(16)]
    views = capture(scene, ring_cameras(demo_scene(), 16, 64), names)
    write_cameras(views, out / "cameras.json", overwrite=True)
    start(whole, source, "-f").wait()
    moments = random.Random(0)
    for number in range(kills):
        folder, moment = out / f"killed_{number}", moments.uniform(0, SPAN)
        state = folder / "checkpoint.safetensors"
        process = start(folder, source, "-f")
        while not state.exists() and process.poll() is None:
            time.sleep(0.02)
        time.sleep(moment)
        process.kill()
        killed = process.wait() != 0
        step = load_state(state).record["work"]["steps"] if state.exists() else None
        code = start(folder, source, "--resume", "-f").wait()
        found = difference(folder, whole)
        line = f"killed {killed} {moment:.1f} s after the first checkpoint, at step {step}; "
        print(f"{line}exit code {code}, largest difference {found:.1e}", flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
