"""PlayCanvas' .compressed.ply: chunks of 256 Gaussians, 16 bytes each and one a SH coefficient."""

from __future__ import annotations

from pathlib import Path

from gsedit.files.ply import PlyHeader
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


def is_compressed(header: PlyHeader) -> bool:
    """Whether this PLY has PlayCanvas' packed layout, whatever the file's name."""
    vertex = header.element("vertex")
    return vertex is not None and "packed_position" in vertex.names


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Read a .compressed.ply through gsply. Raises InputError for a damaged file."""
    import gsply

    table = unpacked(path, lambda: gsply.plyread(path))
    header = SceneHeader(table.degree)
    return SceneSource(path, ".compressed.ply", header, len(table), lambda: in_blocks(table))


def write(path: Path, header: SceneHeader, blocks: Blocks, options: WriteOptions) -> int:
    """Write through gsply; the number of rows."""
    import gsply

    table = gather(blocks, header, 0)
    gsply.plywrite(path, to_gsply(table), compressed=True)
    return len(table)
