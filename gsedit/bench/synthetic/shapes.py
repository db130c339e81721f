"""Solids as signed distances: closures from points to distances, negative inside.

`*b` any batch of points. Every closure is 1-Lipschitz (it never exceeds the distance to the
surface), so that sphere tracing cannot step through a surface. Formulas: Quilez, "3D signed
distance functions".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from math import cos, radians, sin
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

Points: TypeAlias = Float[Tensor, "*b 3"]
"""Positions in world units."""
Distances: TypeAlias = Float[Tensor, "*b"]
"""Distances in world units."""
Sdf: TypeAlias = Callable[[Points], Distances]
"""Signed distance at points, negative inside the solid."""
Triple: TypeAlias = Sequence[float | int]


def length(*components: Distances) -> Distances:
    """Euclidean length of vectors given by their components; its gradient at zero is zero."""
    first, *others = components
    square = first * first
    for component in others:
        square = torch.addcmul(square, component, component)
    return square.clamp_min(1e-30).sqrt()  # the floor keeps the slope finite, in float32 too


def sphere(radius: float, center: Triple = (0.0, 0.0, 0.0)) -> Sdf:
    """A ball around `center`."""

    def distance(points: Points) -> Distances:
        x, y, z = points.unbind(-1)
        return length(x - center[0], y - center[1], z - center[2]) - radius

    return distance


def box(half_sides: Triple, rounding: float = 0.0) -> Sdf:
    """A box around the origin with edges rounded by `rounding`, which `half_sides` includes."""
    inner = [side - rounding for side in half_sides]

    def distance(points: Points) -> Distances:
        x, y, z = (c.abs() - side for c, side in zip(points.unbind(-1), inner))
        outside = length(x.clamp_min(0), y.clamp_min(0), z.clamp_min(0))
        inside = torch.maximum(x, torch.maximum(y, z))
        inside = torch.where(inside > 0, 0.0, inside)  # at 0 a clamp has no slope, since torch 2.14
        return outside + inside - rounding

    return distance


def torus(major: float, minor: float) -> Sdf:
    """A ring around the z axis: `major` is the radius of the ring, `minor` that of its tube."""

    def distance(points: Points) -> Distances:
        x, y, z = points.unbind(-1)
        return length(length(x, y) - major, z) - minor

    return distance


def capsule(start: Triple, end: Triple, radius: float) -> Sdf:
    """All points within `radius` of the segment from `start` to `end`."""
    axis = [b - a for a, b in zip(start, end)]
    square = sum(a * a for a in axis)

    def distance(points: Points) -> Distances:
        offset = [c - a for c, a in zip(points.unbind(-1), start)]
        along = sum(o * (a / square) for o, a in zip(offset, axis)).clamp(0, 1)  # pyright: ignore
        return length(*(o - along * a for o, a in zip(offset, axis))) - radius

    return distance


def cylinder(radius: float, half_height: float, rounding: float = 0.0) -> Sdf:
    """A disc or pillar along z, around the origin, with its rims rounded by `rounding`."""

    def distance(points: Points) -> Distances:
        x, y, z = points.unbind(-1)
        radial = length(x, y) - (radius - rounding)
        axial = z.abs() - (half_height - rounding)
        inside = torch.maximum(radial, axial)
        inside = torch.where(inside > 0, 0.0, inside)
        return length(radial.clamp_min(0), axial.clamp_min(0)) + inside - rounding

    return distance


def union(*solids: Sdf) -> Sdf:
    """Whatever is in any of the solids."""

    def distance(points: Points) -> Distances:
        return reduce(torch.minimum, (solid(points) for solid in solids))

    return distance


def smooth_union(blend: float, *solids: Sdf) -> Sdf:
    """A union with its creases filled over about `blend` world units (Quilez' quadratic one)."""

    def pair(a: Distances, b: Distances) -> Distances:
        overlap = (blend - (a - b).abs()).clamp_min(0)
        return torch.minimum(a, b) - overlap * overlap / (4 * blend)

    def distance(points: Points) -> Distances:
        return reduce(pair, (solid(points) for solid in solids))

    return distance


def cut_off(solid: Sdf, height: float) -> Sdf:
    """The part of a solid above a height."""

    def distance(points: Points) -> Distances:
        return torch.maximum(solid(points), height - points[..., 2])

    return distance


def translate(solid: Sdf, offset: Triple) -> Sdf:
    """The solid moved by `offset`."""

    def distance(points: Points) -> Distances:
        # by columns: the tracer's points are stored coordinate-major, and so they stay
        return solid(torch.stack([c - o for c, o in zip(points.unbind(-1), offset)]).movedim(0, -1))

    return distance


def rotate(solid: Sdf, axis: Triple, degrees: float) -> Sdf:
    """The solid turned about an axis through the origin, right-handed (Rodrigues' formula)."""
    size = sum(a * a for a in axis) ** 0.5
    x, y, z = (a / size for a in axis)
    cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)
    c, s = cos(radians(degrees)), sin(radians(degrees))
    rotation = torch.eye(3, dtype=torch.float64) + s * cross + (1 - c) * (cross @ cross)
    columns = rotation.T.tolist()  # x @ R is the inverse rotation of a row vector

    def distance(points: Points) -> Distances:
        coordinates = points.unbind(-1)
        turned = [sum(p * r for p, r in zip(coordinates, column)) for column in columns]
        return solid(torch.stack(turned).movedim(0, -1))  # pyright: ignore

    return distance


def mirror(solid: Sdf) -> Sdf:
    """The solid's half at x > 0, and its reflection in the plane x = 0."""

    def distance(points: Points) -> Distances:
        x, y, z = points.unbind(-1)
        return solid(torch.stack((x.abs(), y, z)).movedim(0, -1))

    return distance


def gradient(solid: Sdf, points: Points) -> Points:
    """The exact gradient of the distance: of unit length, along the normal, near a surface."""
    with torch.enable_grad():
        variable = points.detach().requires_grad_()
        (slope,) = torch.autograd.grad(solid(variable).sum(), variable)
    return slope
