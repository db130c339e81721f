"""The renderer's benchmark scene: the points of mip-NeRF 360's garden with drawn shapes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from rasterizer import Camera, Gaussians
from rasterizer.numerics import SH_DC

POINTS = Path(__file__).parents[2] / "shared" / "data" / "garden_points.npz"


def garden(scale: float = 1.0, path: Path = POINTS) -> tuple[Gaussians, Camera]:
    """111,785 Gaussians, float32, and the first camera: 648x420 times `scale`.

    The points inside [-2, 2]^3 keep their colours; scales, rotations and opacities are drawn, in
    this order, from NumPy's default_rng(0). Raises FileNotFoundError where the points are absent.
    """
    data = np.load(path)
    inside = (np.abs(data["means3d"]) <= 2).all(1)
    count = int(inside.sum())
    rng = np.random.default_rng(0)
    scales = rng.random((count, 3)) * (0.02 - 1e-4) + 1e-4
    quats = rng.standard_normal((count, 4))
    opacities = rng.random(count)
    scene = Gaussians(
        means=torch.from_numpy(data["means3d"][inside]),
        quats=torch.from_numpy(quats / np.linalg.norm(quats, axis=1, keepdims=True)),
        log_scales=torch.from_numpy(scales).log(),
        logit_opacities=torch.logit(torch.from_numpy(opacities)),
        sh=torch.from_numpy((data["colors"][inside] / 255 - 0.5) / SH_DC)[:, None],
    )
    k, pose = data["Ks"][0], torch.from_numpy(data["viewmats"][0]).double()
    width, height = int(data["width"]), int(data["height"])
    fx, fy, cx, cy = (float(k[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    camera = Camera(pose, fx, fy, cx, cy, width, height)
    return scene.to(torch.float32), camera.resized(round(width * scale), round(height * scale))
