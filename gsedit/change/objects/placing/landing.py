"""Place and surface that an object comes to stand at: where it rests whole, reaches into nothing,
and is seen.

`c` places, the cells of a coarse map; world units, float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.objects.placing.placement import RelativePlace
from gsedit.change.objects.placing.stance import (
    BASE,
    RANK,
    STEP,
    Stance,
    carrier,
    extents,
    heights_from_above,
    map_around,
    size_of,
)
from gsedit.views.dataset import evenly_spaced
from gsedit.views.place import Place
from gsedit.views.relief import Relief
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

Vector = Float[Tensor, "3"]

COARSE = 3
"""Cells of a map along the side of a place."""
WIDEST = 21
"""Places on either side of a middle at which an object's shape ends."""
FEWEST, CROWDED = 0.3, 0.25
"""Least share of its base that is carried at any place, and largest share of its outline, from
above, that is over something higher."""
TWIGS = 0.03
"""Such a share that is in nobody's way: twigs and haze."""
LEVEL = 0.7
"""Difference in height, of the object's, from the place that is asked for up to which one is free.
"""
OVER_EDGE, INTO, UNSEEN = 4.0, 8.0, 1.5
"""How far away, in the object's size, a place counts whose base nothing carries, where all of the
outline is over something higher, and that no camera sees."""
AS_GOOD = 0.1
"""Distance, in the object's size, for which no other place than the asked one is taken."""
VIEWS, VIEW_PIXELS, MARGIN = 12, 64, 0.04
"""Most cameras that are asked what they see, the longer side of their pictures, and the border of
a picture, of its sides, that does not count."""
SHAPE, WHOLE = 50, 3
"""Most points of an object that are looked for in pictures, and the power of the share of them that
a camera sees: one that sees it whole counts more than several that see parts."""
HIDDEN = 0.04
"""Way behind what is seen, of the distance, from which a point is hidden."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A scene that an object is set down in, and how it is looked at."""

    scene: Gaussians
    place: Place
    cameras: Sequence[Camera] = ()

    def map(self, center: Vector, radius: float, ceiling: float) -> Relief:
        """Its heights around a point."""
        up = self.place.up
        return heights_from_above(self.scene, center, radius, up, ceiling)


def free_point(
    body: Gaussians,
    stance: Stance,
    wish: Vector,
    radius: float,
    ground: Ground,
    taken: Float[Tensor, "m 3"] | None = None,
    way: Vector | None = None,
) -> Vector | None:
    """The best place near a point for an object: distance is weighed against the share of its base
    that is carried, what it reaches into, and the cameras that see it.

    Nothing stands over points that are `taken`. A `way` is the direction from them that it is to
    be in; without one, places before the wish count as nearer than those behind. None where no
    place is.
    """
    up, size = ground.place.up, size_of(body)
    seen = ground.map(wish, radius, float(wish @ up) + 1.1 * stance.height)
    tops = seen.tops if taken is None else seen.tops.masked_fill(seen.under(taken), torch.inf)
    level, carried, into = _standing(body, stance, seen, tops)
    centers = seen.camera.pixel_centers()[1::COARSE, 1::COARSE].double()
    points = seen.camera.unproject(centers, torch.ones_like(level))
    points = points + (level - points @ up)[..., None] * up
    fits = (carried >= FEWEST) & (into <= CROWDED)
    fits &= (level - wish @ up).abs() <= LEVEL * stance.height
    if way is not None and taken is not None:
        fits &= _on_the_way(points, taken.double(), wish, way)
    if not bool(fits.any()):
        return None
    points, carried, into = points[fits], carried[fits], into[fits]
    away = points - wish
    cost = away.norm(dim=-1) / size
    cost = cost + OVER_EDGE * (1 - carried) + INTO * (into - TWIGS).clamp_min(0)
    shape = body.means[:: 1 + len(body) // SHAPE].double() - stance.foot
    shown = _shown(points, shape, ground, taken)
    if bool((shown > 0).any()):
        cost = cost + torch.where(shown > 0, UNSEEN * (1 - shown / shown.amax()), torch.inf)
    best, asked = int(cost.argmin()), int((away - (away @ up)[:, None] * up).norm(dim=-1).argmin())
    near = float((away[asked] - (away[asked] @ up) * up).norm()) < COARSE * seen.pixel
    return wish if near and cost[asked] < cost[best] + AS_GOOD else points[best]


def _on_the_way(
    points: Float[Tensor, "*c 3"], taken: Float[Tensor, "m 3"], wish: Vector, way: Vector
) -> Bool[Tensor, "*c"]:
    """Flag the places that are in a direction from what is taken more than beside it."""
    middle = taken.median(0).values
    ahead = (points - middle) @ way
    across = (points - wish) - ((points - wish) @ way)[..., None] * way
    return (ahead > 0.7 * float((wish - middle) @ way)) & (across.norm(dim=-1) < ahead)


def _standing(
    body: Gaussians, stance: Stance, seen: Relief, tops: Float[Tensor, "y x"]
) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """The height on which an object comes to lie at each place, the share of its base that is
    carried there, and the share of its outline that is over something higher."""
    highest = torch.nn.functional.max_pool2d(tops[None, None], COARSE, COARSE)[0, 0]
    away = (body.means.double() - stance.foot) @ torch.stack((seen.right, seen.down)).T
    cells = (away / (COARSE * seen.pixel)).round().long().clamp(-WIDEST, WIDEST)
    rise = (body.means.double() - stance.foot) @ stance.up
    low = rise <= BASE * stance.height
    shapes = [_shape(cells[low if bool(low.any()) else rise <= rise.median()]), _shape(cells)]
    half = WIDEST
    padded = torch.nn.functional.pad(highest, (half,) * 4, value=-torch.inf)
    windows = padded.unfold(0, 2 * half + 1, 1).unfold(1, 2 * half + 1, 1)
    under, over = (windows[..., shape].sort(-1).values for shape in shapes)
    level = under[..., int(RANK * (under.shape[-1] - 1))]
    tolerance = BASE * stance.height
    off = (under - level[..., None]).abs() <= tolerance
    into = (over > level[..., None] + tolerance).double().mean(-1)
    return level, (off & level.isfinite()[..., None]).double().mean(-1), into


def _shape(cells: Tensor) -> Bool[Tensor, "k k"]:
    """The places, around a middle one, that cells are at."""
    shape = torch.zeros(2 * WIDEST + 1, 2 * WIDEST + 1, dtype=torch.bool)
    shape[cells[:, 1] + WIDEST, cells[:, 0] + WIDEST] = True
    return shape


def _shown(
    points: Float[Tensor, "c 3"],
    shape: Float[Tensor, "s 3"],
    ground: Ground,
    taken: Float[Tensor, "m 3"] | None,
) -> Float[Tensor, " c"]:
    """How well cameras see a shape at each place: whole, and not before what is `taken`; less those
    that are in it."""
    total = torch.zeros(len(points), dtype=torch.float64)
    plain = replace(ground.scene, sh=ground.scene.sh[:, :1])
    middle = shape.mean(0)
    radius = (shape - middle).norm(dim=-1).amax()
    asked = evenly_spaced(len(ground.cameras), VIEWS)
    for camera in (ground.cameras[i].fitted(VIEW_PIXELS) for i in asked):
        depth = render(plain, camera, median_depth=True).median_depth
        assert depth is not None
        behind = torch.where(depth > 0, (1 + HIDDEN) * depth.double(), torch.inf).flatten()
        if taken is not None:
            pixel, z = _pixels(camera, taken)
            behind[pixel[z < behind[pixel]]] = 0.0
        pixel, z = _pixels(camera, points[:, None] + shape)
        total += (z < behind[pixel]).double().mean(1) ** WHOLE
        total -= ((points + middle - camera.center.double()).norm(dim=-1) < radius).double()
    return total / max(len(asked), 1)


def _pixels(camera: Camera, points: Float[Tensor, "*c 3"]) -> tuple[Tensor, Tensor]:
    """The number of each point's pixel, and its depth: infinite outside the picture."""
    xy, z, inside = camera.pictured(points, MARGIN)
    column, row = torch.where(inside[..., None], xy, 0.0).long().unbind(-1)
    return row * camera.width + column, z.masked_fill(~inside, torch.inf)


GAP = 0.15
"""Free distance between two things that stand beside each other, of the placed one's height."""
CARRIED = 0.25
"""Least share of what is under an object's base that must be there for it to stand."""
AGREES = 0.05
"""Difference, of its height, up to which a plane around it is the surface under it."""
SEARCHED = 2.5
"""Distance within which a free place is searched, in the larger of both sizes."""
STEEP, LAYER = 3.0, 0.05
"""Step between cells next to each other, of their side, that is not level; and the thickness of a
layer in which a ground is looked for, of the radius."""


@dataclass(frozen=True, eq=False)
class Landing:
    """The surface that an object is set on."""

    point: Vector
    normal: Vector
    found: bool
    """Whether there is one; else the object stays at its height."""


def directions(place: Place) -> dict[str, Vector]:
    """The unit vectors of the sides, as the cameras see them."""
    right = torch.linalg.cross(place.up, place.front)
    return {"right": right, "left": -right, "front": place.front, "behind": -place.front}


def extent(points: Float[Tensor, "m 3"], direction: Vector) -> tuple[float, float]:
    """Begin and end of points along a unit vector, stray ones left out."""
    low, high = extents((points.double() @ direction)[:, None])[:, 0].tolist()
    return low, high


def point_beside(
    body: Gaussians, stance: Stance, other: Gaussians, beside: RelativePlace, ground: Ground
) -> Vector:
    """The point where the middle of an object comes to stand beside another; not yet on a surface.

    Where no free place is: on top, its middle; on a side, the place at the same height that is the
    gap away; "beside", that on its right.
    """
    place = ground.place
    if beside.side == "on":
        top = top_of(other, place.up)
        found = free_point(body, stance, top, _reach(other, place.up), ground)
        return top if found is None else found
    middle = other.means.double().median(0).values
    base = middle + (extent(other.means, place.up)[0] - middle @ place.up) * place.up
    way = directions(place)["right" if beside.side == "beside" else beside.side]
    _, far = extent(other.means, way)
    near, _ = extent(body.means.double() - stance.foot, way)
    gap = GAP * stance.height
    wish = base + (far - near + gap - base @ way) * way
    reach = SEARCHED * max(size_of(other) / 2, float(stance.height))
    if beside.side == "beside":
        found = free_point(body, stance, base, reach, ground, other.means)
    else:
        found = free_point(body, stance, wish, reach, ground, other.means, way)
    return wish if found is None else found


def _reach(body: Gaussians, up: Vector) -> float:
    """Distance of the farthest of an object from its middle, level; stray ones left out."""
    away = body.means.double() - body.means.double().median(0).values
    level = (away - (away @ up)[:, None] * up).norm(dim=-1)
    return float(extents(level[:, None])[1, 0])


def top_of(other: Gaussians, up: Vector) -> Tensor:
    """The middle of what of an object is seen from above, as high as most of it is."""
    points = other.means.double()
    begins, last = extent(points, up)
    middle = points.median(0).values
    away = (points - middle).norm(dim=-1)
    radius = 1.1 * float(extents(away[:, None])[1, 0]) + 1e-9
    seen = heights_from_above(other, middle, radius, up, last + 0.1 * (last - begins))
    if not bool(seen.there.any()):
        return middle + (last - middle @ up) * up
    level = float(seen.heights[seen.there].median())
    there = seen.points[seen.there & ((seen.heights - level).abs() <= BASE * (last - begins))]
    point = (there.amin(0) + there.amax(0)) / 2
    return point + (level - point @ up) * up


def ground_near(ground: Ground, radius: float) -> Vector:
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


def land(body: Gaussians, foot: Vector, stance: Stance, rest: Gaussians, ceiling: float) -> Landing:
    """The surface under an object that was moved to stand at `foot`, at most `ceiling` high."""
    up = stance.up
    seen = map_around(body, rest, foot, up, ceiling)
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


def carried(body: Gaussians, stance: Stance, rest: Gaussians) -> tuple[float, float]:
    """Shares, in [0, 1], of an object's base that is over a surface at the height of its foot, and
    of its outline from above that something else than this surface reaches into."""
    ceiling = float(stance.foot @ stance.up) + STEP * stance.height
    seen = map_around(body, rest, stance.foot, stance.up, ceiling)
    at = _under(body, stance.foot, stance, seen)
    off = (seen.tops[at] - stance.foot @ stance.up).abs()
    level = float((off <= BASE * stance.height).double().mean())
    top = float(stance.foot @ stance.up) + stance.height
    seen = map_around(body, rest, stance.foot, stance.up, top)
    others = seen.tops > stance.foot @ stance.up + BASE * stance.height
    outline = seen.under(body.means)
    return level, float((outline & others).sum() / outline.sum().clamp_min(1))


def _under(body: Gaussians, foot: Vector, stance: Stance, seen: Relief) -> Bool[Tensor, "h w"]:
    """The cells under an object's base."""
    heights = (body.means.double() - foot) @ stance.up
    low = heights <= BASE * stance.height
    return seen.under(body.means[low if bool(low.any()) else heights <= heights.median()])
