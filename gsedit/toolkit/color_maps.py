"""Maps of colors, done to scenes whose colors depend on the direction they are seen from.

`n` Gaussians, `k` SH coefficients a channel, `m` colors, `d` directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import isqrt

import numpy as np
from jaxtyping import Float, Float32, Float64

from gsedit.scene.quaternions import even_directions, harmonics
from rasterizer.numerics import SH_DC

ColorMap = Callable[[Float64[np.ndarray, "m 3"]], Float64[np.ndarray, "m 3"]]
"""From display colors (sRGB, about [0, 1]) to display colors."""

SEEN_FROM = 2
"""Directions, as many times as there are coefficients, in which a map is done to a color."""
COLORS_AT_ONCE = 1 << 19
"""Colors that a map is given at a time: 12 MB."""


@dataclass(frozen=True, eq=False)
class Affine:
    """color -> matrix color + offset."""

    matrix: Float64[np.ndarray, "3 3"]
    offset: Float64[np.ndarray, "3"]

    def __call__(self, colors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        return colors @ self.matrix.T + self.offset

    def then(self, other: Affine) -> Affine:
        """This one first, then the other."""
        return Affine(other.matrix @ self.matrix, other.matrix @ self.offset + other.offset)


def mapped(sh: Float32[np.ndarray, "n k 3"], color_map: ColorMap) -> Float32[np.ndarray, "n k 3"]:
    """The coefficients of Gaussians after a map of their colors.

    An affine map is done exactly, from every direction: its matrix acts on every coefficient, its
    offset on the first. Any other is done to the colors in `SEEN_FROM` k even directions, and what
    that changes is fitted by harmonics of the same degree; colors below 0 are mapped as 0, which
    is how they are drawn.
    """
    n, k, _ = sh.shape
    if isinstance(color_map, Affine):
        after = sh.astype(np.float64) @ color_map.matrix.T
        grey = np.full(3, 0.5)
        after[:, 0] += (color_map(grey[None])[0] - grey) / SH_DC
        return after.astype(np.float32)
    values, fit = _seen(isqrt(k) - 1)
    after = np.empty_like(sh)
    rows = max(1, COLORS_AT_ONCE // len(values))
    for start in range(0, n, rows):
        before = sh[start : start + rows].astype(np.float64)
        colors = np.maximum(0.5 + np.einsum("dk,nkc->ndc", values, before), 0)
        moved = color_map(colors.reshape(-1, 3)).reshape(colors.shape)
        after[start : start + rows] = before + np.einsum("kd,ndc->nkc", fit, moved - colors)
    return after


@lru_cache(4)
def _seen(degree: int) -> tuple[Float64[np.ndarray, "d k"], Float64[np.ndarray, "k d"]]:
    """(harmonics in even directions, their pseudo-inverse)."""
    count = 1 if degree == 0 else SEEN_FROM * (degree + 1) ** 2
    values = harmonics(even_directions(count), degree)
    return values, np.linalg.pinv(values)


@dataclass(frozen=True, eq=False)
class Table3D:
    """A map of colors as a cube of them, linear between its entries."""

    grid: Float[np.ndarray, "s s s 3"]
    """The colors of red, green, blue at 0, 1 / (s - 1), ..., 1."""

    def __call__(self, colors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        """Colors are clipped to [0, 1] first."""
        from scipy.ndimage import map_coordinates

        places = np.clip(colors, 0, 1).T * (len(self.grid) - 1)
        return np.stack(
            [map_coordinates(c, places, order=1) for c in np.moveaxis(self.grid, -1, 0)], -1
        )


def as_table(color_map: ColorMap, side: int = 33) -> Table3D:
    """A map that takes long, in a cube of `side`^3 colors."""
    axis = np.linspace(0, 1, side)
    corners = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    return Table3D(color_map(corners.reshape(-1, 3)).reshape(corners.shape))
