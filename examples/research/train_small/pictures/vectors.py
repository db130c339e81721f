"""Directions and rotations: of one thing in Python's floats, of many in tensors."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin, sqrt
from typing import TypeAlias

from jaxtyping import Float
from torch import Tensor

Point: TypeAlias = Sequence[float | int]
"""Coordinates x, y, z."""
Axes: TypeAlias = Sequence[Point]
"""Three unit vectors at right angles, one a row."""

UPRIGHT: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def turned(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Axes:
    """The axes of a thing turned about its x (roll), then y (pitch), then z (yaw); radians."""
    cy, sy, cp, sp, cr, sr = cos(yaw), sin(yaw), cos(pitch), sin(pitch), cos(roll), sin(roll)
    return (
        (cy * cp, sy * cp, -sp),
        (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
        (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
    )


def direction(azimuth: float, elevation: float) -> Point:
    """The unit vector at an azimuth from +x toward +y and an elevation; radians."""
    return (cos(azimuth) * cos(elevation), sin(azimuth) * cos(elevation), sin(elevation))


def norm(a: Point) -> float:
    """Length of a vector."""
    return sqrt(sum(c * c for c in a))


def unit(a: Point) -> Point:
    """The vector at length 1."""
    size = max(norm(a), 1e-9)
    return (a[0] / size, a[1] / size, a[2] / size)


def cross(a: Point, b: Point) -> Point:
    """Cross product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def normalized(vectors: Float[Tensor, "*b"], dim: int) -> Float[Tensor, "*b"]:
    """Unit vectors along an axis, 0 where they are 0; on short axes far faster than torch's own."""
    first, *rest = (part * part for part in vectors.unbind(dim))
    square = sum(rest, first)
    return vectors * square.clamp_min(1e-20).rsqrt().unsqueeze(dim)
