"""A scene seen from above, in parallel rays: the heights of what something could stand on.

Heights are world units along an upward unit vector. `n` Gaussians, `h w` cells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.light.place import Place
from gsedit.light.shadows import parallel_map
from gsedit.scene.quantiles import weighted_quantile
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

CELLS = 192
"""Cells along the side of a map: of an object that fills half of it, one is 1 % of its width."""

SEEN_ABOVE = 0.54
"""Height of a surface over the centers of the discs that draw it, in their standard deviation:
discs are drawn wider and nearer than they are (gsedit.synthetic.splats.SINK over DISC)."""
MOST_ABOVE = 0.16
"""Largest standard deviation that counts for it, of the radius: wider ones are haze."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Places of what is seen from above at most `ceiling` high."""

    camera: Camera
    up: Float[Tensor, "3"]
    points: Float[Tensor, "h w 3"]
    """World points, float64; their heights are -inf where nothing is."""
    heights: Float[Tensor, "h w"]

    @property
    def cell(self) -> float:
        """Side of a cell, world units."""
        return 1 / self.camera.fx

    def cells_of(self, points: Float[Tensor, "m 3"]) -> tuple[Int[Tensor, " m"], Int[Tensor, " m"]]:
        """Rows and columns of the cells that points are over; those beyond are at the border."""
        xy, _ = self.camera.project(points.double())
        rows, columns = xy[:, 1].long(), xy[:, 0].long()
        height, width = self.heights.shape
        return rows.clamp(0, height - 1), columns.clamp(0, width - 1)

    def under(self, points: Float[Tensor, "m 3"]) -> Bool[Tensor, "h w"]:
        """Flag the cells that points are over, and those next to them."""
        flags = torch.zeros(self.heights.shape)
        flags[self.cells_of(points)] = 1.0
        return torch.nn.functional.max_pool2d(flags[None], 3, stride=1, padding=1)[0] > 0


def heights_from_above(
    scene: Gaussians,
    center: Float[Tensor, "3"],
    radius: float,
    up: Float[Tensor, "3"],
    ceiling: float,
    execution: Execution = AUTO,
) -> HeightMap:
    """The heights of a scene around a point; what is above the ceiling is not there."""
    middle = center + (ceiling - 2 * radius - center @ up) * up  # the eye is at the ceiling
    place = Place(middle, up, perpendicular(up), 2 * radius, radius)
    below = scene.means.double() @ up <= ceiling
    seen = replace(scene, sh=scene.sh[:, :1])[below].detach()
    drawn = parallel_map(seen, place, up, CELLS, execution)
    points = drawn.camera.unproject(drawn.camera.pixel_centers(), drawn.depth.double())
    found = HeightMap(drawn.camera, up, points, _along(points, up))
    lift = _lift(seen, found, radius)
    return replace(found, points=points + lift * up, heights=found.heights + lift)


def _lift(scene: Gaussians, seen: HeightMap, radius: float) -> float:
    """Height of what is seen in a map over the centers of its Gaussians."""
    points = scene.means.double()
    sizes = scene.log_scales.sort(-1).values[:, 1].exp().double()
    xy, _ = seen.camera.project(points)
    near = ((xy >= 0) & (xy < CELLS)).all(-1)
    shown = near & ((points @ seen.up - seen.heights[seen.cells_of(points)]).abs() < sizes / 2)
    if not bool(shown.any()):
        return 0.0
    typical = weighted_quantile(sizes[shown, None], scene.opacities[shown].double(), 0.5)
    return SEEN_ABOVE * min(float(typical), MOST_ABOVE * radius)


def _along(points: Float[Tensor, "h w 3"], up: Float[Tensor, "3"]) -> Float[Tensor, "h w"]:
    return (points @ up).nan_to_num(-torch.inf, neginf=-torch.inf)


OUTLINE_CELLS = 384
"""Cells along the side of a picture of an outline: half of one is less than 0.2 % of the object."""
SIDES = 4
"""Directions from which an outline is looked at."""
LOWEST, HIGHEST = 0.02, 0.995
"""Ranks among the columns of outlines at which an object begins and ends."""
PAST = 0.4
"""Height of an outline over the edge of what discs cover, in their median standard deviation."""


def reach(
    body: Gaussians, up: Float[Tensor, "3"], execution: Execution = AUTO
) -> tuple[float, float]:
    """The heights at which what is seen of an object from its sides begins and ends.

    An outline is where its opacity is one half: haze around an object does not count.
    """
    points = body.means.double()
    middle = (points.amin(0) + points.amax(0)) / 2
    radius = 1.1 * float((points - middle).norm(dim=-1).amax()) + 1e-9
    wide = body.log_scales.sort(-1).values[:, 1]
    shown = torch.cat(_outlines(body, middle, radius, up, execution), 1)
    shown = shown[:, shown.any(0)]
    if not shown.shape[1]:  # haze only
        heights = points @ up
        return float(heights.amin()), float(heights.amax())
    rows = torch.arange(OUTLINE_CELLS, dtype=torch.float64)[:, None]
    last = torch.where(shown, rows + 1, -torch.inf).amax(0).quantile(1 - LOWEST)
    first = torch.where(shown, rows, torch.inf).amin(0).quantile(1 - HIGHEST)
    top, cell = float(middle @ up) + radius, 2 * radius / OUTLINE_CELLS
    edge = PAST * min(float(wide.median().exp()), MOST_ABOVE * radius)
    return top - cell * float(last) + edge, top - cell * float(first) - edge


def _outlines(
    body: Gaussians,
    middle: Float[Tensor, "3"],
    radius: float,
    up: Float[Tensor, "3"],
    execution: Execution,
) -> list[Bool[Tensor, "h w"]]:
    """Flags of the pixels that show an object from each of SIDES; rows go down."""
    side = perpendicular(up)
    across = torch.linalg.cross(up, side)
    place = Place(middle, up, side, 2 * radius, radius)
    angles = torch.arange(SIDES, dtype=torch.float64) * (torch.pi / SIDES)
    views = (each.cos() * side + each.sin() * across for each in angles)
    drawn = (parallel_map(body, place, view, OUTLINE_CELLS, execution) for view in views)
    return [each.depth.isfinite() for each in drawn]
