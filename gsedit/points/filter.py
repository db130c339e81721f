"""Keep what is selected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool

from gsedit.files.table import SplatTable, table_of
from gsedit.points.operation import Scene, apply
from gsedit.points.selection.base import Selection
from gsedit.points.selection.part import OnSelection
from gsedit.points.selection.where import where


@dataclass(frozen=True)
class Filter(OnSelection):
    """Keep the selected rows, in their order."""

    removes: ClassVar[bool] = True

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        rows = np.flatnonzero(inside)
        return table if len(rows) == len(table) else table[rows]


def filter(scene: Scene, selection: Selection | str) -> Scene:
    """The scene without what is not selected. A text is an expression for `where`."""
    return apply(scene, Filter(selection=as_selection(selection)))


def select(scene: Any, selection: Selection | str) -> Bool[np.ndarray, " n"]:
    """Whether each Gaussian of a SplatTable or a Gaussians is selected."""
    table = scene if isinstance(scene, SplatTable) else table_of(scene)
    return as_selection(selection).mask(table)


def as_selection(selection: Selection | str) -> Selection:
    """The selection itself, or that of an expression."""
    return where(selection) if isinstance(selection, str) else selection
