"""Disagreement of edited views where they show the same surface.

`v` views of `h w` pixels.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.warp import warp
from gsedit.measures.metrics import rmse
from rasterizer.camera import Camera


@dataclass(frozen=True, eq=False)
class WarpError:
    """How far views differ in color where they show the same surface."""

    pairs: tuple[tuple[int, int], ...]
    rmse: tuple[float, ...]
    """Per pair, over the pixels that both see; nan where there are none."""
    coverage: tuple[float, ...]
    """Per pair, fraction of view a's pixels that were compared. An error over 1 % means little."""

    @property
    def mean(self) -> float:
        """RMSE over all compared pixels of all pairs; nan if there are none."""
        total = sum(self.coverage)
        square = sum(c * e**2 for c, e in zip(self.coverage, self.rmse) if c)
        return sqrt(square / total) if total else nan


@torch.no_grad()
def warp_error(
    images: Float[Tensor, "v h w 3"],
    cameras: Sequence[Camera],
    depths: Float[Tensor, "v h w"],
    alphas: Float[Tensor, "v h w"],
    pairs: Sequence[tuple[int, int]] | None = None,
) -> WarpError:
    """Each pair's RMSE between view a and view b warped into a, where `correspond.warp` is valid.

    `pairs` defaults to every pair once. On a camera path, short range is (t, t - 1) and long range
    (t, t - 7). Depths are the unedited scene's, in world units along the view,
    unless the edit moved the geometry. Compare with the same number for the unedited pictures:
    shading and resampling make it more than zero.
    """
    pairs = tuple(pairs or itertools.combinations(range(len(images)), 2))
    errors, coverage = [], []
    views = list(zip(cameras, depths, alphas, strict=True))
    for a, b in pairs:
        warped, valid = warp(images[b], *views[a], *views[b])
        errors.append(rmse(warped, images[a], valid) if valid.any() else nan)
        coverage.append(valid.double().mean().item())
    return WarpError(pairs, tuple(errors), tuple(coverage))
