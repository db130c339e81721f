"""Operations on a part of a scene, in parts as long as its selection allows."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool

from gsedit.files.streams import Blocks, SceneHeader, in_blocks
from gsedit.files.table import SplatTable, concatenate_tables
from gsedit.points.operation import Operation, Say
from gsedit.points.selection.base import EVERYTHING, Selection


@dataclass(frozen=True)
class OnSelection(Operation):
    """An operation that treats the selected rows of a scene in one way and the others in another.

    It is given the whole scene at once only if the selection needs that.
    """

    selection: Selection = field(default=EVERYTHING, kw_only=True)

    @abstractmethod
    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        """Rows afterwards; `inside` tells which are selected. Does not write into `table`."""

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        if self.selection.whole:
            tables = list(blocks)
            blocks = iter([concatenate_tables(tables)] if tables else [])
            tables.clear()
        for table in blocks:
            yield from in_blocks(self.change(table, self.selection.mask(table)))
