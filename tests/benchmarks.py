"""Fixtures of several benchmark tests: a measurement, a worker, a garden."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from research.renderer.measurements import RenderMeasurement
from research.renderer.worker import Worker


def render_measurement(**fields) -> RenderMeasurement:
    """A plausible measurement, with some fields changed."""
    values = dict(
        scene="columns", implementation="gsedit", knob="default", value="", gaussians=1000,
        width=64, height=48, pairs=5000, evaluated=320_000, dtype="float32",
        threads=2, runs=5, forward_wall=0.030, forward_cpu=0.055, both_wall=0.090, both_cpu=0.160,
        error_mean=8e-8, error_tail=2e-6, error_max=3e-4, gradient_error=2e-5,
        gradient_cosine=1 - 1e-9, peak_bytes=50_000_000, note="", commit="abc1234",
        machine="A processor, 2 cores, torch 2.13.0", date="2026-01-02T03:04:05+00:00",
    )  # fmt: skip
    return RenderMeasurement(**(values | fields))


class SameProcess(Worker):
    """Calls functions where it stands: starting another process takes seconds."""

    def call(self, function, *args):
        return function(*args)


def garden_points(path: Path) -> Path:
    """A garden of 400 points, as the real file is made."""
    rng = np.random.default_rng(1)
    pose = np.eye(4)
    pose[2, 3] = 5.0
    k = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    np.savez(path, means3d=rng.uniform(-2.5, 2.5, (400, 3)), colors=rng.integers(0, 256, (400, 3)),
             Ks=np.stack([k] * 3), viewmats=np.stack([pose] * 3), width=64, height=48)  # fmt: skip
    return path
