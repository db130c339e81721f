"""Niantic's .spz: versions 1 to 4 in, version 3 out."""

from __future__ import annotations

from math import floor, log2
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.files.quantised import to_gsply, unpacked
from rasterizer.scene import Gaussians

LIMIT = (1 << 23) - 1
"""Positions are signed fixed-point numbers of 24 bits."""
FRACTIONAL_BITS = 12
"""Of a position at most: Niantic's default."""


def read_spz(path: Path) -> Gaussians:
    """Read an .spz through gsply: versions 1-3, and 4 where the package zstandard is installed.

    Coordinates are taken as stored: the specification has RUB axes, but not all writers do.
    Raises InputError for a damaged file.
    """
    import gsply

    return unpacked(path, lambda: gsply.read_spz(path))


def write_spz(scene: Gaussians, path: Path) -> None:
    """SPZ version 3 through gsply, positions as fine as the scene's extent allows.

    Raises UsageError beyond 4e6 from the origin and above SH degree 3.
    """
    import gsply

    extent = max(float(scene.means.abs().max()), 1e-6)
    bits = min(FRACTIONAL_BITS, floor(log2(LIMIT / extent)))
    if bits < 1:
        raise UsageError(f"{path}: .spz holds positions up to 4e6, not {extent:.3g}: save a .ply")
    gsply.write_spz(path, to_gsply(scene, path), fractional_bits=bits)
