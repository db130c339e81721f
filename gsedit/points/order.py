"""The order of the rows: near ones together (smaller files, faster views), or large ones first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from gsedit.errors import UsageError
from gsedit.files.morton import morton_order
from gsedit.files.table import SplatTable
from gsedit.points.operation import Say, Scene, Whole, apply


@dataclass(frozen=True)
class Order(Whole):
    """Sort the rows along Morton's curve, or by importance: opacity times projected area."""

    sorts: ClassVar[bool] = True
    by: str = "morton"

    def __post_init__(self) -> None:
        if self.by not in ("morton", "importance"):
            raise UsageError(f"order by {self.by}: morton and importance are possible")

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        if self.by == "morton":
            return table[morton_order(table.means)]
        return table[np.argsort(-importance(table), kind="stable")]


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
