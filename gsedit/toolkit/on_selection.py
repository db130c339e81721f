"""Operations on a part of a scene, in parts as long as its selection allows."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gsedit.formats.streams import Blocks, SceneHeader, in_blocks
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, concatenate_tables
from gsedit.select.rules import EVERYTHING, Selection, given
from gsedit.toolkit.operation import Operation, Say, Whole, apply


@dataclass(frozen=True)
class OnSelection(Operation):
    """An operation that treats the selected rows of a scene in one way and the others in another.

    It is given parts of a scene, whatever the selection needs to see.
    """

    selection: Selection = field(default=EVERYTHING, kw_only=True)

    @abstractmethod
    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        """Rows afterwards; `inside` tells which are selected. Does not write into `table`."""

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        for table, inside in masked(blocks, self.selection):
            yield from in_blocks(self.change(table, inside))


@dataclass(frozen=True)
class OnOnePart(Operation):
    """Operations that keep all rows, one after the other, on what is selected before the first."""

    operations: tuple[Any, ...]
    """Each with a field `selection`, which is replaced."""
    selection: Selection

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        if any(isinstance(each, Whole) for each in self.operations):
            tables = list(blocks)
            blocks = iter([concatenate_tables(tables)] if tables else [])
        for table, inside in masked(blocks, self.selection):
            some = (replace(each, selection=given(inside)) for each in self.operations)
            yield from in_blocks(apply(table, *some, say=say))


def masked(
    blocks: Blocks, selection: Selection
) -> Iterator[tuple[SplatTable, Bool[np.ndarray, " n"]]]:
    """The rows with their flags, in parts. All are read first only if the selection needs that."""
    if not selection.whole:
        for table in blocks:
            yield table, selection.mask(table)
        return
    tables = list(blocks)
    if tables:
        looked_at = tables if selection.view_dependent else map(without_bands, tables)
        inside = selection.mask(concatenate_tables(looked_at))
        ends = np.cumsum([len(table) for table in tables])
        yield from zip(tables, np.split(inside, ends[:-1]))


def without_bands(table: SplatTable) -> SplatTable:
    """The table without the bands of SH above the first, which are most of its memory."""
    return table.replace(sh=table.sh[:, :1])
