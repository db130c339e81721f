"""The volumetric regulariser of Vox-E for Gaussians: what was dense stays dense.

Vox-E (Sella et al. 2023, section 3.2) edits a grid of densities f and keeps it correlated with the
unedited grid f0: L = 1 - Cov(f, f0) / sqrt(Var(f) Var(f0)), over all voxels. Structure is kept, and
any increasing affine change of it is free. Here `n` Gaussians take the place of voxels.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rasterizer.scene import Gaussians

EPSILON = 1e-7
"""Added to the product of standard deviations, as in Vox-E's code."""
CONSTANT = 1e-10
"""Variance below which the original has no structure that could be kept: rounding."""


def correlation(a: Float[Tensor, "n c"], b: Float[Tensor, "n c"]) -> Float[Tensor, " c"]:
    """Pearson's, channel by channel, in [-1, 1]; 1 where b is constant."""
    a, b = a - a.mean(0), b - b.mean(0)
    variance = b.square().mean(0)
    # the root has no gradient at 0: where one of them is constant, it would be NaN
    product = (a.square().mean(0) * variance).clamp_min(EPSILON**2)
    found = (a * b).mean(0) / (product.sqrt() + EPSILON)
    return torch.where(variance > CONSTANT, found, 1.0)


def correlation_loss(
    scene: Gaussians, original: Gaussians, rows: Bool[Tensor, " n"]
) -> Float[Tensor, ""]:
    """(1 - corr(o, o0)) + mean over R, G, B of (1 - corr(c, c0)), in [0, 4], 0 for the original.

    o are opacities in [0, 1], c base colours (the SH coefficients of degree 0), of the Gaussians in
    `rows`. Vox-E has the first term alone; opacities alone would not hold an edit of colours.
    """
    opacity, colour = (
        correlation(part(scene)[rows], part(original)[rows]) for part in (_opacities, _colours)
    )
    return (1 - opacity).mean() + (1 - colour).mean()


def _opacities(scene: Gaussians) -> Float[Tensor, "n 1"]:
    return torch.sigmoid(scene.logit_opacities)[:, None]


def _colours(scene: Gaussians) -> Float[Tensor, "n 3"]:
    return scene.sh[:, 0]
