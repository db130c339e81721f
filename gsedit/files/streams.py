"""Scenes in parts, so that a file may be larger than memory: what readers give, writers take.

A format is a module with `open_source(path, options) -> SceneSource` and `write(path, header,
blocks, options) -> int`, listed in `formats.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gsedit.files.table import SPLAT_FIELDS, SplatTable, concatenate_tables, uninitialised

AT_ONCE = 1 << 18
"""Rows that a reader gives at a time: 65 MB at SH degree 3."""

Blocks = Iterator[SplatTable]
"""The rows of a scene in order, in tables of any length, with one SH degree and set of columns."""


@dataclass(frozen=True, eq=False)
class SceneHeader:
    """What holds for all rows of a scene."""

    degree: int
    """Of the spherical harmonics, 0 to 4."""
    extra: Mapping[str, np.dtype] = field(default_factory=dict)
    """The extra columns of every row, in the file's order."""
    comments: tuple[str, ...] = ()
    """The file's own, without the word `comment`."""
    elements: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Other tables of the file (SHARP's intrinsics, ...), as structured arrays; small."""
    antialiased: bool = False
    """Whether the scene was trained for a renderer with Mip-Splatting's 2D filter."""

    def replace(self, **changes: object) -> SceneHeader:
        """A copy with other values in some fields."""
        return replace(self, **changes)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True, eq=False)
class SceneSource:
    """A scene file that was opened: its header is read and checked, its rows are not."""

    path: Path
    format: str
    """For a person: `INRIA .ply`, `.spz version 3`."""
    header: SceneHeader
    count: int
    """Of the Gaussians, as the file announces and its size allows."""
    blocks: Callable[[], Blocks]
    """Reads the rows from the first; raises InputError where the file is damaged. Values are as
    the file has them: NaN and Inf too."""
    notes: tuple[str, ...] = ()
    """What of the file is left out, and what was assumed, one sentence each."""

    def table(self) -> SplatTable:
        """All rows at once."""
        return gather(self.blocks(), self.header, self.count)


@dataclass(frozen=True)
class ReadOptions:
    """What a file cannot say of itself."""

    spz_frame: str = "rub"
    """Axes of an .spz that names none: rub (its specification) or rdf (as some writers store)."""


@dataclass(frozen=True)
class WriteOptions:
    """Choices of the formats that have any."""

    spz_version: int = 3
    """3 (read by most) or 4."""
    spz_frame: str = "rub"
    """Axes to store: rub (the specification) or rdf."""


AS_SPECIFIED = ReadOptions()
USUAL = WriteOptions()


def gather(blocks: Blocks, header: SceneHeader, count: int) -> SplatTable:
    """All rows as one table; `count` is a guess of their number, which saves a copy if right."""
    whole = uninitialised(count, header.degree, header.extra)
    rest, filled = [], 0
    for block in blocks:
        end = filled + len(block)
        if rest or end > count:
            rest.append(block)
            continue
        for name in SPLAT_FIELDS:
            getattr(whole, name)[filled:end] = getattr(block, name)
        for name, column in whole.extra.items():
            column[filled:end] = block.extra[name]
        filled = end
    whole = whole if filled == count else whole[:filled]
    return concatenate_tables([whole, *rest])


def in_blocks(table: SplatTable, rows: int = AT_ONCE) -> Blocks:
    """A table in parts of `rows` rows."""
    for start in range(0, len(table), rows):
        yield table[start : start + rows]
