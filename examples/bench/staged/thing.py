"""A named solid in its paint, and solids that are moved or covered.

`*b` points. World units; up is +z.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.bench.synthetic.paint import Paint
from gsedit.bench.synthetic.shapes import Distances, Points, Sdf, Triple
from gsedit.scene.similarity import Similarity

CLINGS = 0.017
"""World units that snow is swept up by more than it adds, and then thinned by along the normal:
none lies on what is steep, and the sides of a thing stay its own. No rounding of an edge is as
large: at that depth under a level face its gradient has a kink."""
SWEEP = 3
"""Heights at which a layer that is swept up is looked at."""
COLUMN = 0.04
"""Step, world units, of the look up from a point: what is thinner may let snow through."""


@dataclass(frozen=True, eq=False)
class Thing:
    """A solid with a name and a paint without light."""

    name: str
    """Color and kind, as a person says them: "red ball"."""
    solid: Sdf
    coat: Paint
    low: Triple
    """Corner of its box, world units: its foot is at low[2]."""
    high: Triple

    @property
    def height(self) -> float:
        """Vertical extent, world units."""
        return self.high[2] - self.low[2]

    @property
    def foot(self) -> np.ndarray:
        """Middle of the lower face of its box (3,)."""
        low, high = np.array(self.low), np.array(self.high)
        return np.array((*(0.5 * (low + high))[:2], low[2]))

    def moved(self, similarity: Similarity) -> Thing:
        """The thing and its paint after a similarity without a mirror."""
        turn = torch.from_numpy(similarity.turn)
        shift, scale = torch.from_numpy(similarity.translation), similarity.scale

        def before(points: Points) -> Points:
            return (points - shift.to(points)) @ turn.to(points) / scale

        low, high = np.array(self.low), np.array(self.high)
        corners = np.stack(np.meshgrid(*zip(low, high)), -1).reshape(-1, 3)
        corners = similarity.points(corners)
        return replace(
            self,
            solid=lambda points: scale * self.solid(before(points)),
            coat=lambda points: self.coat(before(points)),
            low=tuple(corners.min(0).tolist()),
            high=tuple(corners.max(0).tolist()),
        )


def snow_on(covered: Sdf, whole: Sdf, thickness: float, top: float) -> Sdf:
    """A layer on what faces up, of `thickness` world units on level places and less on slopes,
    where nothing of `whole` is above it; `top` is the height above which nothing is.

    Snow that fell straight down: beneath a solid there is none.
    """
    lift = thickness + CLINGS
    heights = torch.linspace(0, lift, SWEEP).tolist()

    def swept(points: Points) -> Distances:
        return torch.stack(
            [covered(points - points.new_tensor((0, 0, height))) for height in heights]
        ).amin(0)

    def above(points: Points) -> Distances:
        """Less than 0 beneath a solid."""
        nearest = whole(points)
        rows, height = torch.arange(len(points)), torch.zeros_like(nearest)
        step = nearest
        while len(rows):
            height = height + step.detach().clamp_min(COLUMN)
            going = (points[rows, 2].detach() + height < top) & (step > -COLUMN)
            rows, height = rows[going], height[going]
            step = whole(points[rows] + height[:, None] * points.new_tensor((0.0, 0.0, 1.0)))
            nearest = nearest.index_put((rows,), torch.minimum(nearest[rows], step))
        return nearest

    def distance(points: Points) -> Distances:
        near = covered(points)
        result = near - thickness  # from afar a bound will do
        rows = near < 2 * lift
        close = points[rows]
        if len(close):
            layer = torch.maximum(swept(close) + CLINGS, -above(close))
            result = result.masked_scatter(rows, layer)
        return result

    return distance


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
