"""Balls, boxes and drums: one by one while a scene is built, then as columns of tensors."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from research.train_small.pictures.vectors import UPRIGHT, Axes, Point, cross, norm, unit

BALL, BOX, DRUM = 0, 1, 2  # ellipsoid, box, and frustum of a cone along its third axis


class Solid(NamedTuple):
    """A ball, box or drum with half axes `half` along the rows of `axes`; world units."""

    kind: int
    center: Point
    half: Point
    material: int
    """Its number among the scene's: 0 is a subject's main one, 1 and 2 those of its details."""
    axes: Axes = UPRIGHT
    taper: float = 1.0
    """Radius of a drum's top over that of its foot."""
    subject: bool = True


class Solids(NamedTuple):
    """Solids as columns: `k` solids, float32."""

    kind: Int[Tensor, " k"]
    center: Float[Tensor, "k 3"]
    half: Float[Tensor, "k 3"]
    material: Int[Tensor, " k"]
    axes: Float[Tensor, "k 3 3"]
    taper: Float[Tensor, " k"]
    subject: Bool[Tensor, " k"]

    def rows(self, index: Int[Tensor, " j"] | Bool[Tensor, " k"]) -> Solids:
        """The solids of these numbers, in this order, or those where a mask is true."""
        return Solids(*(column[index] for column in self))

    @property
    def to_local(self) -> Float[Tensor, "k 3 3"]:
        """From offsets in the world to coordinates in which each reaches from -1 to 1."""
        return self.axes / self.half[:, :, None]

    def local(self, points: Float[Tensor, "m 3"]) -> Float[Tensor, "k 3 m"]:
        """World points in every solid's own coordinates."""
        return self.to_local @ (points.T - self.center[:, :, None])


def columns(solids: Sequence[Solid]) -> Solids:
    """`k` solids as columns."""
    kind, center, half, material, axes, taper, subject = (torch.tensor(c) for c in zip(*solids))
    return Solids(
        kind, center.float(), half.float(), material, axes.float(), taper.float(), subject
    )


def ball(center: Point, half: Point | float, material: int, axes: Axes = UPRIGHT) -> Solid:
    """An ellipsoid of half axes `half`, or a sphere of that radius; world units."""
    half = half if isinstance(half, Sequence) else (half, half, half)
    return Solid(BALL, center, half, material, axes)


def box(center: Point, half: Point, material: int, axes: Axes = UPRIGHT) -> Solid:
    """A box of half sides `half`; world units."""
    return Solid(BOX, center, half, material, axes)


def drum(center: Point, radius: float, half: float, material: int, taper: float = 1.0) -> Solid:
    """An upright frustum of height 2 `half` and radii `radius` below, `taper` times that above."""
    return Solid(DRUM, center, (radius, radius, half), material, taper=taper)


def limb(start: Point, end: Point, radius: float, material: int) -> Solid:
    """A long ball around two points, `radius` beyond them; world units."""
    return _between(BALL, start, end, radius, radius, material)


def rod(start: Point, end: Point, radius: float, material: int) -> Solid:
    """A cylinder from one point to another; world units."""
    return _between(DRUM, start, end, radius, 0.0, material)


def _between(
    kind: int, start: Point, end: Point, radius: float, beyond: float, material: int
) -> Solid:
    across = [b - a for a, b in zip(start, end)]
    z = unit(across)
    x = unit(cross((1.0, 0.0, 0.0) if abs(z[0]) < 0.7 else (0.0, 1.0, 0.0), z))
    center = tuple((a + b) / 2 for a, b in zip(start, end))
    half = (radius, radius, norm(across) / 2 + beyond)
    return Solid(kind, center, half, material, (x, cross(z, x), z))


def placed(solids: Sequence[Solid], yaw: float, scale: float, base: Point) -> list[Solid]:
    """Solids turned about z (radians), scaled and set down at `base`."""
    c, s = cos(yaw), sin(yaw)

    def turn(v: Point) -> Point:
        return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    return [
        solid._replace(
            center=tuple(scale * a + b for a, b in zip(turn(solid.center), base)),
            half=tuple(scale * a for a in solid.half),
            axes=tuple(turn(row) for row in solid.axes),
        )
        for solid in solids
    ]
