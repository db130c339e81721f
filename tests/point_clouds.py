"""Scenes of small round Gaussians, for tests that need positions only."""

from __future__ import annotations

import math

import torch

from rasterizer import Gaussians
from rasterizer.numerics import SH_DC


def cloud(means: torch.Tensor, color=(1.0, 0.0, 0.0), degree: int = 0) -> Gaussians:
    """Opaque round Gaussians of one color."""
    n = len(means)
    sh = torch.zeros(n, (degree + 1) ** 2, 3)
    sh[:, 0] = (torch.tensor(color) - 0.5) / SH_DC
    return Gaussians(
        means.float(),
        torch.tensor([1.0, 0, 0, 0]).repeat(n, 1),
        torch.full((n, 3), math.log(0.05)),
        torch.full((n,), 3.0),
        sh,
    )


def ball(n: int = 200) -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    return cloud(torch.randn(n, 3, generator=generator))
