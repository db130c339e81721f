"""Selections by a volume that the center of a Gaussian is in; its surface is inside.

Coordinates and lengths are those of the scene's file (see gsedit.scene.table).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, isnan

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool, Float32
from gsedit.scene.table import SplatTable
from gsedit.scene.volumes import inside_ball, inside_box, squared_norm
from gsedit.toolkit.selection.base import QUIET, Selection

Vector = tuple[float, float, float]
UNTURNED: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Box(Selection):
    """Along the axes, between two corners; infinite where a side is open."""

    low: Vector = (-inf, -inf, -inf)
    high: Vector = (inf, inf, inf)

    def __post_init__(self) -> None:
        if any(isnan(number) for number in (*self.low, *self.high)):
            raise UsageError("box: a corner is not a number")
        for axis, low, high in zip("xyz", self.low, self.high):
            if low > high:
                raise UsageError(
                    f"box: {axis} goes from {low:g} to {high:g}: give the lower corner first"
                )

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return inside_box(table.means, self.low, self.high)


@dataclass(frozen=True)
class OrientedBox(Selection):
    """About `center`, of sides `size`, turned by `degrees` (see `gsedit.toolkit.steps.rotate`)."""

    center: Vector
    size: Vector
    degrees: Vector = UNTURNED

    def __post_init__(self) -> None:
        check_finite("oriented_box", *self.center, *self.degrees)
        check_positive("oriented_box", "side", *self.size)

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        half = np.array(self.size, np.float32) / 2
        return np.all(np.abs(_along_axes(table, self.center, self.degrees)) <= half, axis=1)


@dataclass(frozen=True)
class Ellipsoid(Selection):
    """About `center`, of three `radii`, turned by `degrees` (see `gsedit.toolkit.steps.rotate`)."""

    center: Vector
    radii: Vector
    degrees: Vector = UNTURNED

    def __post_init__(self) -> None:
        check_finite("ellipsoid", *self.center, *self.degrees)
        check_positive("ellipsoid", "radius", *self.radii)

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        scaled = _along_axes(table, self.center, self.degrees) / np.array(self.radii, np.float32)
        return squared_norm(scaled) <= 1


@dataclass(frozen=True)
class Sphere(Selection):
    """Select a ball about `center`."""

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        check_finite("sphere", *self.center)
        check_positive("sphere", "radius", self.radius)

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return inside_ball(table.means, self.center, self.radius)


@dataclass(frozen=True)
class Cylinder(Selection):
    """About the axis from `start` to `end`, where it ends too."""

    start: Vector
    end: Vector
    radius: float

    def __post_init__(self) -> None:
        check_finite("cylinder", *self.start, *self.end)
        check_positive("cylinder", "radius", self.radius)
        if self.start == self.end:
            raise UsageError("cylinder: its axis goes from a point to the same one: give two")

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        axis = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(axis))
        unit = (axis / length).astype(np.float32)
        offset = table.means - np.array(self.start, np.float32)
        along = offset @ unit
        across = offset - along[:, None] * unit
        return (
            (along >= 0)
            & (along <= length)
            & (squared_norm(across) <= np.square(np.float64(self.radius)))
        )


@dataclass(frozen=True)
class HalfSpace(Selection):
    """The side of the plane through `point` that `normal` points to."""

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        check_finite("half_space", *self.point, *self.normal)
        if not any(self.normal):
            raise UsageError("half_space: the normal is 0,0,0: give a direction")

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        return (table.means - np.array(self.point, np.float32)) @ normal.astype(np.float32) >= 0


def check_finite(form: str, *numbers: float) -> None:
    """Raise UsageError for a number that is infinite or none."""
    if not all(map(isfinite, numbers)):
        raise UsageError(f"{form}: {', '.join(f'{n:g}' for n in numbers)} are not all finite")


def check_positive(form: str, what: str, *numbers: float) -> None:
    """Raise UsageError for a length that is not a finite number above 0."""
    for number in numbers:
        if not 0 < number < inf:
            raise UsageError(f"{form}: {what} {number:g}: it must be more than 0, and finite")


def _along_axes(table: SplatTable, center: Vector, degrees: Vector) -> Float32[np.ndarray, "n 3"]:
    """Centers in the frame of a volume that is turned by `degrees`."""
    offset = table.means - np.array(center, np.float32)
    if degrees == UNTURNED:
        return offset
    from gsedit.toolkit.steps import rotate  # which imports jaxtyping

    return offset @ rotate(degrees).turn.astype(np.float32)
