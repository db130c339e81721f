"""Place and surface that an object comes to stand at.

`n` Gaussians; world units, float64.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.cameras.place import Place
from gsedit.objects.placing.free import RANK, Ground, free_point
from gsedit.objects.placing.heights import heights_from_above
from gsedit.objects.placing.placement import RelativePlace
from gsedit.objects.placing.stance import BASE, STEP, Stance, carrier, map_around, size_of
from gsedit.surface.relief import Relief
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

CARRIED = 0.25
"""Least share of what is under an object's base that must be there for it to stand."""
AGREES = 0.05
"""Difference, of its height, up to which a plane around it is the surface under it."""
TAIL = 0.01
"""Share of an object's Gaussians that may lie beyond each end of it: stray ones."""
SEARCHED = 2.5
"""Distance within which a free place is searched, in the larger of both sizes."""
STEEP, LAYER = 3.0, 0.05
"""Step between cells next to each other, of their side, that is not level; and the thickness of a
layer in which a ground is looked for, of the radius."""


@dataclass(frozen=True, eq=False)
class Landing:
    """The surface that an object is set on."""

    point: Float[Tensor, "3"]
    normal: Float[Tensor, "3"]
    found: bool
    """Whether there is one; else the object stays at its height."""


def directions(place: Place) -> dict[str, Float[Tensor, "3"]]:
    """The unit vectors of the sides, as the cameras see them."""
    right = torch.linalg.cross(place.up, place.front)
    return {"right": right, "left": -right, "front": place.front, "behind": -place.front}


def extent(points: Float[Tensor, "m 3"], direction: Float[Tensor, "3"]) -> tuple[float, float]:
    """Begin and end of points along a unit vector, stray ones left out."""
    along = (points.double() @ direction).sort().values
    last = len(along) - 1
    return float(along[int(TAIL * last)]), float(along[int((1 - TAIL) * last)])


def point_beside(
    body: Gaussians, stance: Stance, other: Gaussians, beside: RelativePlace, ground: Ground
) -> Float[Tensor, "3"]:
    """The point where the middle of an object comes to stand beside another; not yet on a surface.

    Where no free place is: on top, its middle; on a side, the place at the same height that is the
    gap away; "beside", that on its right.
    """
    place = ground.place
    if beside.side == "on":
        top = top_of(other, place.up, ground.execution)
        found = free_point(body, stance, top, _reach(other, place.up), ground)
        return top if found is None else found
    middle = other.means.double().median(0).values
    base = middle + (extent(other.means, place.up)[0] - middle @ place.up) * place.up
    way = directions(place)["right" if beside.side == "beside" else beside.side]
    _, far = extent(other.means, way)
    near, _ = extent(body.means.double() - stance.foot, way)
    gap = beside.gap * stance.height
    wish = base + (far - near + gap - base @ way) * way
    reach = SEARCHED * max(size_of(other) / 2, float(stance.height))
    if beside.side == "beside":
        found = free_point(body, stance, base, reach, ground, other.means)
    else:
        found = free_point(body, stance, wish, reach, ground, other.means, way)
    return wish if found is None else found


def _reach(body: Gaussians, up: Float[Tensor, "3"]) -> float:
    """Distance of the farthest of an object from its middle, level; stray ones left out."""
    away = body.means.double() - body.means.double().median(0).values
    level = (away - (away @ up)[:, None] * up).norm(dim=-1).sort().values
    return float(level[int((1 - TAIL) * (len(level) - 1))])


def top_of(other: Gaussians, up: Float[Tensor, "3"], execution: Execution = AUTO) -> Tensor:
    """The middle of what of an object is seen from above, as high as most of it is."""
    points = other.means.double()
    begins, ends = extent(points, up)
    middle = points.median(0).values
    away = (points - middle).norm(dim=-1)
    radius = 1.1 * float(away.sort().values[int((1 - TAIL) * (len(away) - 1))]) + 1e-9
    seen = heights_from_above(other, middle, radius, up, ends + 0.1 * (ends - begins), execution)
    if not bool(seen.there.any()):
        return middle + (ends - middle @ up) * up
    level = float(seen.heights[seen.there].median())
    there = seen.points[seen.there & ((seen.heights - level).abs() <= BASE * (ends - begins))]
    point = (there.amin(0) + there.amax(0)) / 2
    return point + (level - point @ up) * up


def ground_near(ground: Ground, radius: float) -> Float[Tensor, "3"]:
    """The point under the middle of a place that is as high as most of what is level around it."""
    place = ground.place
    seen = ground.map(place.center, radius, float(place.center @ place.up) + radius)
    flat = (_blocked(seen, STEEP * seen.pixel) == 0) & seen.there
    if not bool(flat.any()):
        return place.center
    heights = seen.heights[flat]
    step = LAYER * radius
    layers = ((heights - heights.amin()) / step).long()
    fullest = int(torch.bincount(layers).argmax())
    level = heights[(layers - fullest).abs() <= 1].median()
    return place.center + (level - place.center @ place.up) * place.up


def _blocked(seen: Relief, step: float) -> Float[Tensor, "h w"]:
    """1 for cells where the surface has a step, or there is none, else 0."""
    filled = seen.tops.float().nan_to_num(neginf=-1e30)[None]
    top = torch.nn.functional.max_pool2d(filled, 3, stride=1, padding=1)[0]
    bottom = -torch.nn.functional.max_pool2d(-filled, 3, stride=1, padding=1)[0]
    return (top - bottom > step).float()


def land(
    body: Gaussians,
    foot: Float[Tensor, "3"],
    stance: Stance,
    rest: Gaussians,
    ceiling: float,
    execution: Execution = AUTO,
) -> Landing:
    """The surface under an object that was moved to stand at `foot`, at most `ceiling` high."""
    up = stance.up
    seen = map_around(body, rest, foot, up, ceiling, execution)
    at = _under(body, foot, stance, seen)
    under = seen.tops[at]
    there = under[under.isfinite()]
    if len(there) < CARRIED * int(at.sum()):
        return Landing(foot, up, False)
    rough = float(there.quantile(RANK))
    shift = (rough - foot @ up) * up
    lowered = replace(body, means=body.means + shift.to(body.means))
    support = carrier(lowered, seen, up)
    point = foot + shift
    if support is not None:
        normal = torch.from_numpy(support.normal)
        along = (support.offset - point @ normal) / (normal @ up)
        if abs(float(along)) <= AGREES * stance.height:
            return Landing(point + along * up, normal, True)
    return Landing(point, up, True)


def carried(
    body: Gaussians, stance: Stance, rest: Gaussians, execution: Execution = AUTO
) -> tuple[float, float]:
    """Shares, in [0, 1], of an object's base that is over a surface at the height of its foot, and
    of its outline from above that something else than this surface reaches into."""
    ceiling = float(stance.foot @ stance.up) + STEP * stance.height
    seen = map_around(body, rest, stance.foot, stance.up, ceiling, execution)
    at = _under(body, stance.foot, stance, seen)
    off = (seen.tops[at] - stance.foot @ stance.up).abs()
    level = float((off <= BASE * stance.height).double().mean())
    top = float(stance.foot @ stance.up) + stance.height
    seen = map_around(body, rest, stance.foot, stance.up, top, execution)
    others = seen.tops > stance.foot @ stance.up + BASE * stance.height
    outline = seen.under(body.means)
    return level, float((outline & others).sum() / outline.sum().clamp_min(1))


def _under(
    body: Gaussians, foot: Float[Tensor, "3"], stance: Stance, seen: Relief
) -> Bool[Tensor, "h w"]:
    """The cells under an object's base."""
    heights = (body.means.double() - foot) @ stance.up
    low = heights <= BASE * stance.height
    return seen.under(body.means[low if bool(low.any()) else heights <= heights.median()])
