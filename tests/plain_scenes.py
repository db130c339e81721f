"""Plain Gaussians and cameras that laws of edits are tested on, and what it is to keep bits."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rasterizer.camera import Camera, look_at
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians

FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")


def cloud(
    means: Tensor,
    log_scales: float | tuple[float, float, float],
    color: Tensor | float = 0.5,
    logit: float = 4.0,
) -> Gaussians:
    """Gaussians without a turn at places, in display colors."""
    n = len(means)
    return Gaussians(
        means.float(),
        torch.tensor((1.0, 0.0, 0.0, 0.0)).repeat(n, 1),
        torch.as_tensor(log_scales).float().expand(n, 3).clone(),
        torch.full((n,), logit),
        color_to_sh(torch.as_tensor(color).float().expand(n, 3)[:, None].clone()),
    )


def discs(means: Tensor, normals: Tensor, width: float = 0.05) -> Gaussians:
    """Gray discs at places, a tenth as thick as wide, that lie across unit normals."""
    x, y, z = normals.unbind(-1)
    turns = torch.stack((1 + z, -y, x, torch.zeros_like(z)), 1)
    flipped = torch.tensor((0.0, 1.0, 0.0, 0.0))
    sizes = torch.tensor((width, width, width / 10)).log().tolist()
    found = cloud(means, tuple(sizes))
    return replace(found, quats=torch.where(turns.norm(dim=1, keepdim=True) > 1e-3, turns, flipped))


def needles(count: int) -> Gaussians:
    """Needles in a box, turned at random: they show no surface."""
    generator = torch.Generator().manual_seed(3)
    places = torch.rand(count, 3, generator=generator) * 2 - 1
    turned = torch.randn(count, 4, generator=generator)
    return Gaussians(
        places,
        turned,
        torch.tensor((-2.0, -7.0, -7.0)).repeat(count, 1),
        torch.zeros(count),
        torch.zeros(count, 1, 3),
    )


def ring(count: int = 8, height: float = 1.8, middle: float = 0.3) -> list[Camera]:
    """Cameras at a height around the z axis that look down at its middle; the first is at -y."""
    turn = torch.arange(count) * (2 * torch.pi / count) - torch.pi / 2
    eyes = torch.stack((3 * turn.cos(), 3 * turn.sin(), torch.full((count,), height)), -1)
    at, up = torch.tensor((0.0, 0.0, middle)), torch.tensor((0.0, 0.0, 1.0))
    return [look_at(eye, at, up, 50.0, 64, 64) for eye in eyes]


def same_bits(first: Gaussians, second: Gaussians, *, but: tuple[str, ...] = ()) -> bool:
    """Whether two scenes have the same bits, but for some of the fields."""
    names = [name for name in FIELDS if name not in but]
    return all(torch.equal(getattr(first, name), getattr(second, name)) for name in names)


def all_finite(scene: Gaussians) -> bool:
    return all(bool(getattr(scene, name).isfinite().all()) for name in FIELDS)
