"""Inputs of several benchmark tests: a cloud of any size, a garden."""

from __future__ import annotations

from math import tan
from pathlib import Path

import numpy as np
import torch

from gsedit.bench.renderer.speed import Workload
from rasterizer import Camera, Gaussians


def cloud(count: int, width: int, height: int, seed: int = 0) -> Workload:
    """Random Gaussians all over a picture, each 1 to 3 pixels in standard deviation, SH degree 0.

    With the same number of pixels a Gaussian, the work a Gaussian is the same at every size.
    """
    generator = torch.Generator().manual_seed(seed)

    def uniform(columns: int, low: float, high: float) -> torch.Tensor:
        return low + (high - low) * torch.rand(count, columns, generator=generator)

    focal = height / 2 / tan(0.5)
    depth = uniform(1, 2.0, 6.0)
    across = uniform(2, -0.5, 0.5) * torch.tensor((width / focal, height / focal)) * depth
    scene = Gaussians(
        means=torch.cat((across, depth), 1),
        quats=torch.randn(count, 4, generator=generator),
        log_scales=(uniform(3, 1.0, 3.0) * depth / focal).log(),
        logit_opacities=torch.logit(uniform(1, 0.05, 0.95)[:, 0]),
        sh=uniform(3, -1.5, 1.5)[:, None],
    )
    pose = torch.eye(4, dtype=torch.float64)
    camera = Camera(pose, focal, focal, width / 2, height / 2, width, height)
    return Workload(f"cloud of {count:,}", scene, camera)


def garden_points(path: Path) -> Path:
    """A garden of 400 points, as the real file is made."""
    rng = np.random.default_rng(1)
    pose = np.eye(4)
    pose[2, 3] = 5.0
    k = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    np.savez(path, means3d=rng.uniform(-2.5, 2.5, (400, 3)), colors=rng.integers(0, 256, (400, 3)),
             Ks=np.stack([k] * 3), viewmats=np.stack([pose] * 3), width=64, height=48)  # fmt: skip
    return path
