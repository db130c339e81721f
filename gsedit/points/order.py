"""The order of the rows: near ones together (smaller files, faster views), or large ones first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt64

from gsedit.errors import UsageError
from gsedit.files.table import SplatTable
from gsedit.points.operation import Say, Scene, Whole, apply

BITS = 21
"""Of each coordinate: three fit into 64 bits."""


@dataclass(frozen=True)
class Order(Whole):
    """Sort the rows along Morton's curve, or by importance: opacity times projected area."""

    by: str = "morton"

    def __post_init__(self) -> None:
        if self.by not in ("morton", "importance"):
            raise UsageError(f"order by {self.by}: morton and importance are possible")

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        if self.by == "morton":
            return table[np.argsort(morton_codes(table.means), kind="stable")]
        return table[np.argsort(-importance(table), kind="stable")]


def morton_codes(means: Float[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """Places on the curve through the bounding box, points that are not finite are last."""
    finite = np.isfinite(means).all(1)
    codes = np.full(len(means), np.iinfo(np.uint64).max, np.uint64)
    if not finite.any():
        return codes
    points = means[finite].astype(np.float64)
    low = points.min(0)
    extent = max(float((points.max(0) - low).max()), np.finfo(np.float64).tiny)
    cells = ((points - low) / extent * (2**BITS - 1)).astype(np.uint64)
    codes[finite] = sum(_spread(cells[:, axis]) << np.uint64(axis) for axis in range(3))
    return codes


def _spread(cells: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """The bits of each number with two zeros between them."""
    spread = cells.copy()
    for shift, mask in (
        (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
    ):  # fmt: skip
        spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
    return spread


def mean_area(scales: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Of an ellipsoid's shadow over all directions, in units of pi; float64, within 1.1 %.

    Thomsen's formula for the surface of an ellipsoid, p = 1.6075; the mean shadow of a convex body
    is a quarter of its surface (Cauchy).
    """
    a, b, c = scales.astype(np.float64).T ** 1.6075
    return ((a * b + a * c + b * c) / 3) ** (1 / 1.6075)


def importance(table: SplatTable) -> Float[np.ndarray, " n"]:
    """Opacity times mean projected area."""
    return table.opacities.astype(np.float64) * mean_area(table.scales)


def order(scene: Scene, by: str = "morton") -> Scene:
    """The scene with its rows sorted by "morton" or "importance"."""
    return apply(scene, Order(by))
