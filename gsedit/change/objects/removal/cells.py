"""Masks and maps of cells or pixels: distances, connected parts, means. `h w` cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from scipy import ndimage

ANGLES = 18
"""Turns of a rectangle that are tried, in a right angle."""


def away_from(mask: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w"]:
    """The distance of each cell from the nearest flagged one, cells; 0 on them."""
    distance: Any = ndimage.distance_transform_edt(~mask)
    return distance


def depth_in(mask: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w"]:
    """The distance of each flagged cell from what is not flagged or beyond the picture, cells."""
    return away_from(~np.pad(mask, 1))[1:-1, 1:-1]


def parts_of(mask: Bool[np.ndarray, "h w"]) -> tuple[Int64[np.ndarray, "h w"], int]:
    """The number, from 1, of the connected part that each cell is in, 0: none; and the count."""
    found: Any = ndimage.label(mask)
    return found[0].astype(np.int64), found[1]


def touching(
    mask: Bool[np.ndarray, "h w"], source: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """The parts of a mask that touch a source."""
    numbers, _ = parts_of(mask | source)
    return mask & np.isin(numbers, np.unique(numbers[source]))


def widened(mask: Bool[np.ndarray, "h w"], cells: int) -> Bool[np.ndarray, "h w"]:
    """A mask grown by some cells, at least one."""
    return ndimage.binary_dilation(mask, iterations=cells).astype(bool)


def closed(mask: Bool[np.ndarray, "h w"], cells: int) -> Bool[np.ndarray, "h w"]:
    """A mask without gaps of up to twice as many cells."""
    padded = ndimage.binary_closing(np.pad(mask, cells + 1), iterations=cells)
    return padded[cells + 1 : -cells - 1, cells + 1 : -cells - 1].astype(bool)


def opened(mask: Bool[np.ndarray, "h w"], cells: int = 1) -> Bool[np.ndarray, "h w"]:
    """A mask without parts that are at most twice as many cells thin."""
    return ndimage.binary_opening(mask, np.ones((2 * cells + 1,) * 2)).astype(bool)


def enclosing(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """A mask with all that it surrounds."""
    found: Any = ndimage.binary_fill_holes(mask)
    return found


def rectangle_around(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The least rectangle that holds a mask, turned by any of ANGLES angles; empty around none."""
    if not mask.any():
        return mask
    angles = np.linspace(0, np.pi / 2, ANGLES, endpoint=False)
    turns = np.stack((np.cos(angles), np.sin(angles), -np.sin(angles), np.cos(angles)))
    turns = turns.reshape(2, 2, ANGLES)
    along = np.einsum("pi,jia->apj", np.argwhere(mask), turns)
    low, high = along.min(1) - 0.5, along.max(1) + 0.5
    best = int(np.prod(high - low, axis=1).argmin())
    cells = np.argwhere(np.ones_like(mask)) @ turns[..., best].T
    return ((cells > low[best]) & (cells < high[best])).all(1).reshape(mask.shape)


def mean_around(
    values: Float[np.ndarray, "h w c"], weights: Float[np.ndarray, "h w"], sigma: float
) -> Float64[np.ndarray, "h w c"]:
    """Weighted means under a Gaussian window; 0 far from any weight."""
    sums = ndimage.gaussian_filter(values * weights[..., None], (sigma, sigma, 0))
    return sums / np.maximum(ndimage.gaussian_filter(weights, sigma), 1e-6)[..., None]
