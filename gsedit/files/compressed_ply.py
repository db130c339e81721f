"""PlayCanvas' .compressed.ply: chunks of 256 Gaussians, 16 bytes each and one a SH coefficient."""

from __future__ import annotations

from pathlib import Path

from gsedit.files.ply import PlyHeader
from gsedit.files.quantised import to_gsply, unpacked
from rasterizer.scene import Gaussians


def is_compressed(header: PlyHeader) -> bool:
    """Whether this PLY has PlayCanvas' packed layout, whatever the file's name."""
    vertex = header.element("vertex")
    return vertex is not None and "packed_position" in vertex.names


def read_compressed(path: Path) -> Gaussians:
    """Read a .compressed.ply through gsply, after its header and size were checked.

    Raises InputError for a damaged file.
    """
    import gsply

    return unpacked(path, lambda: gsply.plyread(path))


def write_compressed(scene: Gaussians, path: Path) -> None:
    """Write through gsply. Raises UsageError above SH degree 3."""
    import gsply

    gsply.plywrite(path, to_gsply(scene, path), compressed=True)
