"""Keep what is selected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gsedit.formats.streams import Blocks, SceneHeader
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, table_of
from gsedit.select.selection import Selection
from gsedit.select.where import questions, where
from gsedit.toolkit.operation import OnSelection, Say, Scene, apply

if TYPE_CHECKING:
    from gsedit.select.finder import Finder
    from rasterizer.scene import Gaussians


@dataclass(frozen=True)
class Filter(OnSelection):
    """Keep the selected rows, in their order."""

    removes: ClassVar[bool] = True

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        rows = np.flatnonzero(inside)
        return table if len(rows) == len(table) else table[rows]

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        """Yield the kept rows; where none is kept, report where the scene lies."""
        low, high, kept = np.full(3, np.inf), np.full(3, -np.inf), False

        def watched() -> Blocks:
            nonlocal low, high
            for table in blocks:
                if not kept and len(table):
                    low = np.fmin(low, np.fmin.reduce(table.means))
                    high = np.fmax(high, np.fmax.reduce(table.means))
                yield table

        for table in super().blocks(watched(), header, say):
            kept = kept or len(table) > 0
            yield table
        if not kept and np.isfinite([low, high]).all():
            corners = (", ".join(f"{number:.4g}" for number in end) for end in (low, high))
            say("nothing is selected; the centers are from ({}) to ({})".format(*corners))


def filter(scene: Scene, selection: Selection | str) -> Scene:
    """The scene without what is not selected. A text is an expression for `where`."""
    return apply(scene, Filter(selection=as_selection(selection)))


def select(scene: Any, selection: Selection | str) -> Bool[np.ndarray, " n"]:
    """Whether each Gaussian of a SplatTable or a Gaussians is selected."""
    table = scene if isinstance(scene, SplatTable) else table_of(scene)
    return as_selection(selection).mask(table)


def as_selection(selection: Selection | str) -> Selection:
    """The selection itself, or that of an expression."""
    return where(selection, questions(_finder)) if isinstance(selection, str) else selection


def _finder(scene: Gaussians) -> Finder:
    from gsedit.select.finder import Finder  # which loads torch

    return Finder(scene)
