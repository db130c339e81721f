"""Place and surface that an object comes to stand at.

`n` Gaussians; world units, float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.light.place import Place
from gsedit.objects.placing.heights import CELLS, HeightMap, heights_from_above
from gsedit.objects.placing.placement import Beside
from gsedit.objects.placing.stance import BASE, STEP, Stance, carrier, map_around
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

CARRIED = 0.25
"""Least share of what is under an object's base that must be there for it to stand."""
RANK = 0.8
"""Rank of the height that an object comes to lie on, of those under its base: stray leaves and
blades are higher."""
AGREES = 0.05
"""Difference, of its height, up to which a plane around it is the surface under it."""
TAIL = 0.01
"""Share of an object's Gaussians that may lie beyond each end of it: stray ones."""
FREE = 0.12
"""Step of a surface, of the object's height, that is in the way of it."""
BLOCKED = 0.04
"""Share of an object's outline, from above, that may be over such steps: twigs and haze."""
CROWDED = 0.3
"""Such a share beyond which no place is free."""
WIDE = 4.0
"""Reach of what something is put on, of its own, from which it stands at a free place on it."""
SEARCHED = 2.5
"""Distance within which a free place is searched, in the larger of both sizes."""
LEVEL = 0.7
"""Difference in height, of the object's, from the place that is asked for up to which one is free.
"""
BEHIND = 0.7
"""How much farther a place behind something counts than one before it: there it is hidden."""

STEEP, LAYER = 3.0, 0.05
"""Step between cells next to each other, of their side, that is not level; and the thickness of a
layer in which a ground is looked for, of the radius."""
UNSEEN, MARGIN = 2.0, 0.1
"""How much farther a place counts that no camera sees, and the border of a picture, of its sides,
that does not count."""


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
    body: Gaussians,
    stance: Stance,
    other: Gaussians,
    beside: Beside,
    place: Place,
    rest: Gaussians,
    execution: Execution = AUTO,
    cameras: Sequence[Camera] = (),
) -> Float[Tensor, "3"]:
    """The point where the middle of an object comes to stand beside another; not yet on a surface.

    On top, it is at the height of what it stands on; else at that of the other's foot. Where no
    place beside it is free, it is on its right.
    """
    if beside.side == "on":
        top = top_of(other, place.up, execution)
        size, room = _reach(body, place.up), _reach(other, place.up)
        if room < WIDE * size:
            return top
        found = free_point(body, stance, top, room, place, rest, execution, cameras)
        return top if found is None else found
    low, high = other.means.double().amin(0), other.means.double().amax(0)
    middle = other.means.double().median(0).values
    base = middle + (extent(other.means, place.up)[0] - middle @ place.up) * place.up
    if beside.side == "beside":
        size = max(float((high - low).norm()) / 2, float(stance.height))
        reach = SEARCHED * size
        found = free_point(body, stance, base, reach, place, rest, execution, cameras)
        if found is not None:
            return found
    way = directions(place)["right" if beside.side == "beside" else beside.side]
    _, far = extent(other.means, way)
    near, _ = extent(body.means.double() - stance.foot, way)
    center = sum(extent(other.means, way)) / 2
    gap = beside.gap * stance.height
    return base + (far - center + gap - near) * way + (center - base @ way) * way


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
    shown = seen.heights.isfinite()
    if not bool(shown.any()):
        return middle + (ends - middle @ up) * up
    level = float(seen.heights[shown].median())
    there = seen.points[shown & ((seen.heights - level).abs() <= BASE * (ends - begins))]
    point = (there.amin(0) + there.amax(0)) / 2
    return point + (level - point @ up) * up


def free_point(
    body: Gaussians,
    stance: Stance,
    near: Float[Tensor, "3"],
    radius: float,
    place: Place,
    rest: Gaussians,
    execution: Execution = AUTO,
    cameras: Sequence[Camera] = (),
) -> Float[Tensor, "3"] | None:
    """The place nearest to a point where the surface is level and nothing is in the way.

    Places before it count as nearer than those behind, and those that more cameras see as nearer
    than others. None where no place is.
    """
    ceiling = float(near @ place.up) + 1.1 * stance.height
    seen = heights_from_above(rest, near, radius, place.up, ceiling, execution)
    shape = _shape(body, stance, seen)
    blocked = _blocked(seen, FREE * stance.height)
    across = torch.nn.functional.conv2d(blocked[None, None], shape[None, None], padding="same")
    share = across[0, 0] / shape.sum()
    inner = min(min(shape.shape) // 2, CELLS // 4)
    share[:inner] = share[-inner:] = 1.0
    share[:, :inner] = share[:, -inner:] = 1.0
    share[(seen.heights - near @ place.up).abs() > LEVEL * stance.height] = 1.0
    there = share <= max(BLOCKED, min(float(share.amin()), CROWDED))
    if not bool(there.any()):
        return None
    away = seen.points[there] - near
    cost = away.norm(dim=-1) - BEHIND * (away @ place.front).clamp_max(0)
    cost = cost * (1 + UNSEEN * (1 - _seen(seen.points[there], cameras)))
    return seen.points[there][int(cost.argmin())]


def ground_near(
    scene: Gaussians, place: Place, radius: float, execution: Execution = AUTO
) -> Float[Tensor, "3"]:
    """The point under the middle of a place that is as high as most of what is level around it."""
    ceiling = float(place.center @ place.up) + radius
    seen = heights_from_above(scene, place.center, radius, place.up, ceiling, execution)
    flat = (_blocked(seen, STEEP * seen.cell) == 0) & seen.heights.isfinite()
    if not bool(flat.any()):
        return place.center
    heights = seen.heights[flat]
    step = LAYER * radius
    layers = ((heights - heights.amin()) / step).long()
    fullest = int(torch.bincount(layers).argmax())
    level = heights[(layers - fullest).abs() <= 1].median()
    return place.center + (level - place.center @ place.up) * place.up


def _seen(points: Float[Tensor, "m 3"], cameras: Sequence[Camera]) -> Float[Tensor, " m"]:
    """Share of the cameras whose pictures points are in, apart from what may hide them."""
    total = torch.zeros(len(points), dtype=torch.float64)
    for camera in cameras:
        xy, z = camera.project(points)
        size = xy.new_tensor((camera.width, camera.height))
        total += (z > 0) & ((xy > MARGIN * size) & (xy < (1 - MARGIN) * size)).all(-1)
    return total / max(len(cameras), 1)


def _shape(body: Gaussians, stance: Stance, seen: HeightMap) -> Float[Tensor, "k k"]:
    """The cells, of an odd number a side, that an object is over when it stands in the middle."""
    away = (body.means.double() - stance.foot) @ seen.camera.rotation[:2].double().T / seen.cell
    half = int(min(float(away.abs().amax()) + 1, CELLS // 2 - 1))
    cells = (away + half + 0.5).long().clamp(0, 2 * half)
    shape = torch.zeros(2 * half + 1, 2 * half + 1)
    shape[cells[:, 1], cells[:, 0]] = 1.0
    return torch.nn.functional.max_pool2d(shape[None], 3, stride=1, padding=1)[0]


def _blocked(seen: HeightMap, step: float) -> Float[Tensor, "h w"]:
    """1 for cells where the surface has a step, or there is none, else 0."""
    filled = seen.heights.float().nan_to_num(neginf=-1e30)[None]
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
    under = seen.heights[at]
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
    off = (seen.heights[at] - stance.foot @ stance.up).abs()
    level = float((off <= BASE * stance.height).double().mean())
    top = float(stance.foot @ stance.up) + stance.height
    seen = map_around(body, rest, stance.foot, stance.up, top, execution)
    others = seen.heights > stance.foot @ stance.up + BASE * stance.height
    outline = seen.under(body.means)
    return level, float((outline & others).sum() / outline.sum().clamp_min(1))


def _under(
    body: Gaussians, foot: Float[Tensor, "3"], stance: Stance, seen: HeightMap
) -> Bool[Tensor, "h w"]:
    """The cells under an object's base."""
    heights = (body.means.double() - foot) @ stance.up
    low = heights <= BASE * stance.height
    return seen.under(body.means[low if bool(low.any()) else heights <= heights.median()])
