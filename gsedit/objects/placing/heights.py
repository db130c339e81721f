"""A scene seen from above, in parallel rays: the heights of what something could stand on.

Heights are world units along an upward unit vector. `n` Gaussians, `h w` cells.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.cameras.place import Place
from gsedit.light.shadows import parallel_map
from gsedit.scene.quantiles import weighted_quantile
from gsedit.surface.relief import Relief
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

CELLS = 192
"""Cells along the side of a map: of an object that fills half of it, one is 1 % of its width."""

SEEN_ABOVE = 0.54
"""Offset of the rendered surface above Gaussian centers, in their standard deviation (sigmas):
discs are drawn wider and nearer than they are (gsedit.synthetic.splats.SINK over DISC)."""
MOST_ABOVE = 0.16
"""Largest standard deviation that counts for it, of the radius: wider ones are haze."""


def heights_from_above(
    scene: Gaussians,
    center: Float[Tensor, "3"],
    radius: float,
    up: Float[Tensor, "3"],
    ceiling: float,
    execution: Execution = AUTO,
) -> Relief:
    """The heights of a scene around a point; what is above the ceiling is not there."""
    middle = center + (ceiling - 2 * radius - center @ up) * up  # the eye is at the ceiling
    place = Place(middle, up, perpendicular(up), 2 * radius, radius)
    below = scene.means.double() @ up <= ceiling
    seen = replace(scene, sh=scene.sh[:, :1])[below].detach()
    drawn = parallel_map(seen, place, up, CELLS, execution)
    there = drawn.depth.isfinite()
    depth = drawn.depth.double().masked_fill(~there, 0.0)
    found = Relief(drawn.camera, drawn.camera.unproject(drawn.camera.pixel_centers(), depth), there)
    return found.at(found.heights + _lift(seen, found, radius))


def _lift(scene: Gaussians, seen: Relief, radius: float) -> float:
    """Height of what is seen in a map over the centers of its Gaussians."""
    points = scene.means.double()
    sizes = scene.log_scales.sort(-1).values[:, 1].exp().double()
    xy, _ = seen.camera.project(points)
    near = ((xy >= 0) & (xy < CELLS)).all(-1).nonzero().squeeze(-1)
    column, row = xy[near].long().unbind(-1)
    off = (points[near] @ seen.axis - seen.tops[row, column]).abs()
    shown = near[off < sizes[near] / 2]
    if not len(shown):
        return 0.0
    typical = weighted_quantile(sizes[shown, None], scene.opacities[shown].double(), 0.5)
    return SEEN_ABOVE * min(float(typical), MOST_ABOVE * radius)


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
