"""The order of the rows: near ones together (smaller files, faster views), or large ones first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from gsedit.errors import UsageError
from gsedit.scene.merging.pairs import mean_area
from gsedit.scene.morton import morton_order
from gsedit.scene.table import SplatTable
from gsedit.toolkit.operation import Say, Whole


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


def importance(table: SplatTable) -> Float[np.ndarray, " n"]:
    """Opacity times mean projected area."""
    return table.opacities.astype(np.float64) * mean_area(table.scales)
