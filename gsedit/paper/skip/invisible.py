"""Gaussians and bands of spherical harmonics that the edited pictures hardly show.

`n` Gaussians, `v` views, `k` coefficients a channel, `d` degrees from 1 on.
"""

from __future__ import annotations

from math import isqrt, pi, sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

FAINT_SHARE = 1e-4
"""Largest share of any picture that all skipped Gaussians together may carry."""
INVISIBLE_COLOR = 1 / 510
"""Color difference in [0, 1] that no picture shows: half a step of an 8-bit picture."""


def faint_gaussians(shares: Float[Tensor, "v n"], most: float = FAINT_SHARE) -> Bool[Tensor, " n"]:
    """As many Gaussians as together carry at most the share `most` of each picture.

    The faintest come first. `shares`: a Gaussian's blending weights in a view, summed over the
    pixels and divided by the sum over all Gaussians. In every view, the sum over the chosen
    Gaussians is at most the sum of their largest shares.
    """
    largest = shares.amax(0)
    order = largest.argsort()
    faint = torch.zeros(len(largest), dtype=torch.bool)
    faint[order[largest[order].double().cumsum(0) <= most]] = True
    return faint


def band_colors(sh: Float[Tensor, "n k 3"]) -> Float[Tensor, "n d"]:
    """The most that each degree adds to a color, over all directions and channels.

    By Cauchy-Schwarz: the squares of a degree's 2 d + 1 harmonics add up to (2 d + 1) / (4 pi) in
    every direction (the addition theorem).
    """
    degrees = range(1, isqrt(sh.shape[1]))
    columns = [
        sh[:, d * d : (d + 1) ** 2].norm(dim=1).amax(-1) * sqrt((2 * d + 1) / (4 * pi))
        for d in degrees
    ]
    return torch.stack(columns, -1) if columns else sh.new_zeros(len(sh), 0)


def visible_coefficients(sh: Float[Tensor, "n k 3"], seen: Bool[Tensor, " n"]) -> int:
    """Coefficients a channel that an edit renders and fits.

    The highest degrees are not among them where they together add at most `INVISIBLE_COLOR` to
    the color of every Gaussian that is `seen`.
    """
    tails = band_colors(sh)[seen].flip(-1).cumsum(-1).flip(-1)
    colors = tails.amax(0).tolist() if len(tails) else [0.0] * tails.shape[1]
    degree = next((i for i, color in enumerate(colors) if color <= INVISIBLE_COLOR), len(colors))
    return (degree + 1) ** 2
