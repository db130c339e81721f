"""A named solid in its paint, and solids that are moved or covered.

`*b` points. World units; up is +z.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

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
        return torch.stack([covered(_raised(points, -height)) for height in heights]).amin(0)

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


def _raised(points: Points, height: float) -> Points:
    return points + points.new_tensor((0.0, 0.0, height))
