"""Exact light of a sun and a sky on synthetic solids, with the shadows that they cast.

`*b` points. Directions are unit vectors in the world; light is linear, colors are as displayed.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.bench.synthetic.shapes import Points, Sdf, Triple

GAMMA = 2.2
"""Exponent of the display."""
SUN_RAYS = 7
"""Directions on a cone around the sun's, which give its shadow a soft edge."""
START, HIT, LEAST_STEP = 0.015, 5e-4, 4e-3
"""World units of scenes of size 1: where a ray begins above its point, the distance at which it has
hit a solid, and its least step."""


@dataclass(frozen=True)
class Daylight:
    """Light of a sun and a sky; an even sky of (1, 1, 1) gives a level, open place its paint."""

    sun: Triple
    """Direction to the sun, any length."""
    sunlight: Triple
    """Linear light on what faces the sun."""
    sky: Triple
    """Linear light of the open sky on a level place."""
    ground: Triple = (0.15, 0.15, 0.15)
    """Linear light from below on what faces down."""
    blur: float = 0.035
    """Half the angle of the sun, radians."""


def arriving(
    solid: Sdf, points: Points, normals: Points, directions: Float[Tensor, "d 3"], reach: float
) -> Float[Tensor, "*b"]:
    """Light on points of the surface from directions of brightness 1 each, less what hides it."""
    total = points.new_zeros(points.shape[:-1])
    for direction in directions:
        facing = (normals @ direction).clamp_min(0)
        rows = facing > 0
        start = points[rows] + START * normals[rows]
        total[rows] += facing[rows] * reaches(solid, start, direction, reach)
    return total


def reaches(
    solid: Sdf, points: Float[Tensor, "m 3"], direction: Float[Tensor, "3"], reach: float
) -> Bool[Tensor, " m"]:
    """Whether nothing hides the light of a direction from points outside the solid."""
    lit = torch.ones(len(points), dtype=torch.bool)
    rows = torch.arange(len(points))
    along = torch.zeros(len(points), dtype=torch.float64)
    for _ in range(96):  # a ray that skims a surface longer counts as lit
        if not len(rows):
            break
        distance = solid(points[rows] + along[:, None] * direction)
        lit[rows[distance < HIT]] = False
        along = along + distance.clamp_min(LEAST_STEP)
        going = (distance >= HIT) & (along < reach)
        rows, along = rows[going], along[going]
    return lit


def sun_rays(light: Daylight) -> Float[Tensor, "r 3"]:
    """Unit directions to the sun's middle and evenly around its rim; float64."""
    direction = torch.nn.functional.normalize(torch.tensor(light.sun).double(), dim=0)
    axis = torch.nn.functional.one_hot(direction.abs().argmin(), 3).to(direction)
    across = torch.nn.functional.normalize(torch.linalg.cross(direction, axis), dim=0)
    along = torch.linalg.cross(direction, across)
    angle = torch.arange(SUN_RAYS - 1).double() * (2 * torch.pi / (SUN_RAYS - 1))
    ring = direction + light.blur * (angle.cos()[:, None] * across + angle.sin()[:, None] * along)
    return torch.nn.functional.normalize(torch.cat((direction[None], ring)), dim=-1)
