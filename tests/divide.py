"""A scene of many more Gaussians that looks the same: each one divided into smaller ones.

`n` Gaussians, `p` parts of each.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

OVERLAP = 2.0
"""By which the parts' total volume exceeds that of the whole: with 1, gaps would show."""
HIDDEN = 0.004
"""Standard deviation of SH coefficients in bands that the scene has not: below a step of an 8-bit
picture, and yet not zero, so that these bands cannot be left out."""


def divide(scene: Gaussians, parts: int, degree: int, generator: torch.Generator) -> Gaussians:
    """Every Gaussian as `parts` smaller ones of the same mean, covariance and optical depth.

    The parts of one Gaussian are consecutive rows. Bands up to SH `degree` that the scene has not
    hold noise that is too small to be seen. Raises ValueError for fewer than 1 part.
    """
    if parts < 1:
        raise ValueError(f"{parts} parts: give 1 or more")
    shrink = min(1.0, OVERLAP * parts ** (-1 / 3)) if parts > 1 else 1.0
    shrink = min(shrink, 0.9) if parts > 1 else 1.0
    places = _places(parts, generator).to(scene.means) * (1 - shrink**2) ** 0.5
    axes = rotation_matrices(scene.quats) * scene.scales[:, None, :]
    offsets = torch.einsum("nij,pj->npi", axes, places)
    depth = -torch.log1p(-scene.opacities.clamp_max(0.999)) / (parts * shrink**2)
    whole = scene.map(lambda field: field.repeat_interleave(parts, 0))
    return replace(
        whole,
        means=whole.means + offsets.reshape(-1, 3),
        log_scales=whole.log_scales + torch.tensor(shrink).log(),
        logit_opacities=torch.logit(-torch.expm1(-depth)).repeat_interleave(parts),
        sh=_with_bands(whole.sh, degree, generator),
    )


def _places(parts: int, generator: torch.Generator) -> Float[Tensor, "p 3"]:
    """Points of mean 0 and covariance 1 (parts > 3), in any direction."""
    points = torch.randn(parts, 3, generator=generator, dtype=torch.float64)
    points -= points.mean(0)
    if parts > 3:
        factor = torch.linalg.cholesky(points.T @ points / parts)
        points = torch.linalg.solve_triangular(factor, points.T, upper=False).T
    return points


def _with_bands(
    sh: Float[Tensor, "m k 3"], degree: int, generator: torch.Generator
) -> Float[Tensor, "m j 3"]:
    """The coefficients up to the degree; those that there were not are noise."""
    wanted = (degree + 1) ** 2
    if wanted <= sh.shape[1]:
        return sh
    filled = HIDDEN * torch.randn(len(sh), wanted, 3, generator=generator, dtype=sh.dtype)
    filled[:, : sh.shape[1]] = sh
    return filled
