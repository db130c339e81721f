"""Niantic's .spz: versions 1 to 4 in, version 3 out."""

from __future__ import annotations

from math import floor, log2
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.files.quantised import to_gsply, unpacked
from gsedit.files.streams import (
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
    WriteOptions,
    gather,
    in_blocks,
)

LIMIT = (1 << 23) - 1
"""Positions are signed fixed-point numbers of 24 bits."""
FRACTIONAL_BITS = 12
"""Of a position at most: Niantic's default."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Read an .spz through gsply. Raises InputError for a damaged file."""
    import gsply

    table = unpacked(path, lambda: gsply.read_spz(path))
    header = SceneHeader(table.degree)
    return SceneSource(path, ".spz", header, len(table), lambda: in_blocks(table))


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """SPZ version 3 through gsply, positions as fine as the scene's extent allows; the number of
    rows. Raises UsageError beyond 4e6 from the origin.
    """
    import gsply

    table = gather(blocks, header, 0)
    extent = max(float(abs(table.means).max(initial=0)), 1e-6)
    bits = min(FRACTIONAL_BITS, floor(log2(LIMIT / extent)))
    if bits < 1:
        raise UsageError(f"{path}: .spz holds positions up to 4e6, not {extent:.3g}: save a .ply")
    if len(table):
        gsply.write_spz(path, to_gsply(table), fractional_bits=bits)
    return len(table)
