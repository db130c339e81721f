"""Operations on scenes: maps of rows, block by block or all at once."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from gsedit.errors import UsageError
from gsedit.formats.streams import Blocks, SceneHeader, gather, header_of, in_blocks
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, gaussians_of, table_of
from gsedit.select.selection import EVERYTHING, Selection, given, saved_flags

Say = Callable[[str], None]
"""Receives what an operation has to tell a person: one sentence, without the name of a file."""

Scene = TypeVar("Scene")
"""A SplatTable or a Gaussians; not constrained, as naming the second would load torch."""


def silent(text: str) -> None:
    """A `Say` that says nothing."""


@dataclass(frozen=True)
class Operation:
    """A change of a scene: of its rows by `apply`, or by `blocks` where that is not enough."""

    removes: ClassVar[bool] = False
    """Whether it can leave out rows: then how many were kept is told."""
    sorts: ClassVar[bool] = False
    """Whether rows change places: saved flags do not fit afterwards."""

    @property
    def moves(self) -> bool:
        """Whether the whole scene goes elsewhere, so that its cameras do not fit it any more."""
        return False

    @property
    def whole(self) -> bool:
        """Whether `apply` must be given all rows at once, so that the scene is in memory; else it
        works on files larger than memory."""
        return False

    def header(self, header: SceneHeader) -> SceneHeader:
        """Header of the result (SH degree, columns, ...) for the header of the input."""
        return header

    def at(self, path: Path) -> Operation:
        """The operation on the scene of this file, of which only rows were removed before."""
        return self

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        """Some rows afterwards. Does not write into the arrays of `table`."""
        raise NotImplementedError

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        """The rows afterwards. `header` is the one before; `say` may be called until the end."""
        if self.whole:
            blocks = iter([gather(blocks, header, 0)])
        for table in blocks:
            yield from in_blocks(self.apply(table, say))


@dataclass(frozen=True)
class Whole(Operation):
    """An operation that needs the whole scene in memory."""

    @property
    def whole(self) -> bool:
        return True


@dataclass(frozen=True)
class OnSelection(Operation):
    """An operation that treats the selected rows of a scene in one way and the others in another.

    It is given parts of a scene unless the selection needs to see all.
    """

    selection: Selection = field(default=EVERYTHING, kw_only=True)

    @property
    def whole(self) -> bool:
        return self.selection.whole

    @abstractmethod
    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        """Rows afterwards; `inside` tells which are selected. Does not write into `table`."""

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        return self.change(table, self.selection.mask(table))


@dataclass(frozen=True)
class OnOnePart(Operation):
    """Operations that keep all rows, one after the other, on what is selected before the first."""

    operations: tuple[Any, ...]
    """Each with a field `selection`, which is replaced."""
    selection: Selection

    @property
    def whole(self) -> bool:
        return self.selection.whole or any(each.whole for each in self.operations)

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        inside = given(self.selection.mask(table))
        return apply(table, *(replace(each, selection=inside) for each in self.operations), say=say)


@dataclass
class RowCounts:
    """How many rows an operation left of how many; counted while blocks pass."""

    before: int = 0
    after: int = 0

    def __str__(self) -> str:
        share = 100 * (self.after - self.before) / max(self.before, 1)
        return f"kept {self.after:,} of {self.before:,} ({share:+.1f} %)"


def run(
    header: SceneHeader, blocks: Blocks, operations: Sequence[Operation], say: Say = silent
) -> tuple[SceneHeader, Blocks, list[tuple[Operation, RowCounts]]]:
    """One operation after the other: the header and the rows afterwards.

    Nothing is read until the rows are. The counts of every operation are whole when the last row
    has passed. Raises UsageError where saved flags are asked of rows that were sorted before.
    """
    check_saved_flags(operations)
    counts = []
    for operation in operations:
        kept = RowCounts()
        after = operation.blocks(counted(blocks, kept, "before"), header, say)
        blocks = counted(after, kept, "after")
        header = operation.header(header)
        counts.append((operation, kept))
    return header, blocks, counts


def check_saved_flags(operations: Sequence[Operation]) -> None:
    """Raise UsageError where an operation asks saved flags after another one sorted the rows."""
    is_sorted = False
    for operation in operations:
        flags = next(saved_flags(operation), None)
        if is_sorted and flags is not None:
            raise UsageError(
                f"{flags} says which rows of the scene's file are meant, and they are in "
                "another order by then: put --order after what uses it"
            )
        is_sorted = is_sorted or operation.sorts


def apply(scene: Scene, *operations: Operation, say: Say = silent) -> Scene:
    """The scene after the operations, in order; a `Gaussians` becomes a `Gaussians` again, without
    gradients. The scene itself does not change."""
    given: Any = scene
    table = given if isinstance(given, SplatTable) else table_of(given)
    header, blocks, _ = run(header_of(table), iter([table]), operations, say)
    done = gather(blocks, header, 0)
    after: Any = done if isinstance(given, SplatTable) else gaussians_of(done)
    return after


def counted(blocks: Blocks, kept: RowCounts, field: str) -> Iterator[SplatTable]:
    """The blocks, whose rows are added to a field of `kept`."""
    for block in blocks:
        setattr(kept, field, getattr(kept, field) + len(block))
        yield block
