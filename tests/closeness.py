"""Tolerances of these tests, each by its cause; slopes of errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import log

import numpy as np
import torch
from torch import Tensor

from rasterizer import Gaussians

EPS32 = float(np.finfo(np.float32).eps)

NETWORK = 500 * EPS32
"""Share of the largest value by which two runs of a float32 network may differ that sum in another
order: tiny networks, sampled with guidance, differ by 5 to 70 roundings (SSE, AVX2, AVX-512)."""

INPUTS = ("means", "quats", "log_scales", "logit_opacities", "sh")


def leaves(scene: Gaussians) -> Gaussians:
    """A copy whose fields are leaves that take gradients."""
    return scene.map(lambda t: t.clone().requires_grad_())


def tensors(scene: Gaussians) -> list[Tensor]:
    return [getattr(scene, name) for name in INPUTS]


def relative(found: Tensor, wanted: Tensor) -> float:
    """|found - wanted| / |wanted| as vectors; 0 where both are zero."""
    scale = wanted.double().norm()
    difference = (found.double() - wanted.double()).norm()
    return float(difference / scale) if scale > 0 else float(difference)


def assert_near(found: Tensor, wanted: Tensor, share: float) -> None:
    """No value is further off than this share of the largest of `wanted`."""
    largest = float(wanted.detach().abs().max())
    torch.testing.assert_close(found, wanted, rtol=0, atol=share * largest)


def weights_like(picture: Tensor, seed: int = 0) -> Tensor:
    """Fixed random weights: their dot product with a picture is a loss that hides no pixel."""
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(picture.shape, generator=generator, dtype=torch.float64).to(picture)


def slope_error(encode: Callable[[Tensor], Tensor], step: float) -> float:
    """How far the gradient of a random combination of latents is from differences, relatively."""
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(1, 32, 32, 3, generator=generator).requires_grad_()
    direction = torch.randn(images.shape, generator=generator)
    latents = encode(images)
    weights = torch.randn(latents.shape, generator=generator)
    (gradient,) = torch.autograd.grad((weights * latents).sum(), images)
    slope = (gradient * direction).sum()
    with torch.no_grad():
        ahead, behind = (
            (weights * encode(images + sign * step * direction)).sum() for sign in (1, -1)
        )
    return float(((ahead - behind) / (2 * step) - slope).abs() / slope.abs())


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Least-squares slope of log y over log x: 1 where y is proportional to x.

    Raises ValueError for fewer than two different x, or a number that is not positive.
    """
    if any(value <= 0 for point in points for value in point):
        raise ValueError("logarithms need positive numbers")
    if len({x for x, _ in points}) < 2:
        raise ValueError("a slope needs two points that differ in x")
    logs = [(log(x), log(y)) for x, y in points]
    center_x, center_y = (sum(column) / len(logs) for column in zip(*logs))
    rise = sum((x - center_x) * (y - center_y) for x, y in logs)
    return rise / sum((x - center_x) ** 2 for x, _ in logs)
