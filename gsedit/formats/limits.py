"""Bounds of what files may hold: beyond them no capture lies, and arithmetic ends in NaN."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import Any

from gsedit.errors import InputError
from gsedit.scene.shapes import Float

MAX_POSITION = 1e9
"""Largest coordinate, world units. float32 has steps of 64 there, so that no scene is told from a
point; its fourth power, which covariances and their gradients reach, still fits into float32."""
MAX_SH = 65504.0
"""Largest SH coefficient: half precision, in which packed formats keep light, ends here. Its
square times a million pixels still fits into float32."""
MAX_SIDE = 1 << 16
"""Largest side of a camera's picture, pixels: JPEG ends one below."""
MAX_COEFFICIENT = 1e9
"""Largest distortion coefficient: that of any lens is below a thousand."""
FOCAL_MIN, FOCAL_MAX = 1e-3, 1e6
"""Focal length, in longer sides of the picture: from 179.9 degrees to a tenth of an arc second."""


def check_lens(
    focal: tuple[float, float],
    center: tuple[float, float],
    size: tuple[int, int],
    where: str,
    coefficients: Iterable[float] = (),
) -> None:
    """Raise InputError unless the focal lengths (fx, fy), the principal point (cx, cy) and the
    size (width, height), all in pixels, and the distortion can be those of a camera."""
    longest = max(size)
    if not (min(size) >= 1 and longest <= MAX_SIDE):
        raise InputError(
            f"{where}: a size of {size[0]}x{size[1]} pixels is not positive or beyond "
            f"{MAX_SIDE}: correct it"
        )
    if not all(FOCAL_MIN * longest <= each <= FOCAL_MAX * longest for each in focal):
        raise InputError(
            f"{where}: a focal length of {focal[0]:g}, {focal[1]:g} pixels is not positive, or no "
            f"lens has it for {size[0]}x{size[1]} pixels: correct it"
        )
    if not all(isfinite(each) and abs(each) <= 1e3 * longest for each in center):
        raise InputError(
            f"{where}: the principal point {center[0]:g}, {center[1]:g} lies far outside of the "
            f"{size[0]}x{size[1]} pixels: correct it"
        )
    if not all(abs(each) <= MAX_COEFFICIENT for each in coefficients):
        raise InputError(f"{where}: its distortion is not finite or absurd: calibrate it again")


def check_points(xyz: Float[Any, "n 3"], where: str) -> None:
    """Raise InputError for points that are not finite or beyond MAX_POSITION."""
    wrong = ~(xyz.abs() <= MAX_POSITION).all(1)
    if wrong.any():
        row = int(wrong.nonzero()[0])
        raise InputError(
            f"{where}: point {row} (from 0) is not finite or beyond {MAX_POSITION:g}: remove it"
        )


def check_pose(pose: Float[Any, "r 4"], where: str) -> None:
    """Raise InputError for a pose with an entry that is not finite or beyond MAX_POSITION."""
    if not (pose.abs() <= MAX_POSITION).all():
        raise InputError(
            f"{where}: its pose is not finite or beyond {MAX_POSITION:g}: export it again"
        )


ALWAYS_BYTES = 16 << 20
"""Bytes that any file may unpack to."""
MAX_EXPANSION = 1032
"""Largest expansion of deflate. Formats that could expand more are held to it: no scene needs more.
"""


def check_expansion(path: Path, packed: int, unpacked: int) -> None:
    """Raise InputError where `packed` bytes of the file announce too many `unpacked` ones."""
    if unpacked > max(ALWAYS_BYTES, MAX_EXPANSION * packed):
        raise InputError(
            f"{path} announces {unpacked / 1e9:.3g} GB of Gaussians in {packed / 1e6:.3g} MB: "
            "it is damaged or made to fill memory, export it again"
        )
