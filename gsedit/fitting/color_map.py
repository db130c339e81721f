"""A smooth map of colors before an edit to colors after it, fitted where views show both.

`n` Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

RIDGE = 1e-4
"""Variance of colors below which the map adds a constant: it has no slope to learn there."""
LEAST_WEIGHT = 1e-9
"""Floor of weights that are divided by."""


@dataclass(frozen=True, eq=False)
class ColorMap:
    """An affine map of colors."""

    center: Float[Tensor, "3"]
    """Mean of the colors before."""
    offset: Float[Tensor, "3"]
    """Mean of the changes."""
    slope: Float[Tensor, "3 3"]
    """Added to the change for a unit of color from the center."""
    error: float
    """Root mean square of what the map leaves of the changes that it was fitted to."""

    def change(self, colors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """The change of these colors; where they leave [0, 1] by it, only as far as its border."""
        change = self.offset + (colors - self.center) @ self.slope
        low, high = colors.clamp_max(0), colors.clamp_min(1)
        return torch.minimum(torch.maximum(colors + change, low), high) - colors


def fit_color_map(
    colors: Float[Tensor, "n 3"], change: Float[Tensor, "n 3"], weights: Float[Tensor, " n"]
) -> ColorMap:
    """The map that fits these changes of colors best, in the mean of the squares by weight.

    Without any weight it changes nothing.
    """
    share = (weights / weights.sum().clamp_min(LEAST_WEIGHT)).double()[:, None]
    center = (share * colors).sum(0)
    inputs = colors.double() - center
    offset = (share * change).sum(0)
    moments = inputs.T @ (share * inputs) + RIDGE * torch.eye(3, dtype=inputs.dtype)
    slope = torch.linalg.solve(moments, inputs.T @ (share * (change - offset)))
    left = change - offset - inputs @ slope
    error = float((share * left.square()).sum(0).mean().sqrt())
    center, offset, slope = (each.to(colors) for each in (center, offset, slope))
    return ColorMap(center, offset, slope, error)
