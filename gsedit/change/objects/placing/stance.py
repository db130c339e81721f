"""How an object stands: on what plane, at what point, how high it is.

Heights are world units along an upward unit vector. `n` Gaussians, `h w` cells of a map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.scene.framing import ends, weighted_quantile
from gsedit.scene.planes import HOVERS, Plane, find_support
from gsedit.views.orbit import perpendicular
from gsedit.views.place import Place
from gsedit.views.relief import Relief
from gsedit.views.shadows import parallel_map
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

Vector = Float[Tensor, "3"]

CELLS = 192
"""Cells along the side of a map: of an object that fills half of it, one is 1 % of its width."""

SEEN_ABOVE = 0.54
"""Offset of the rendered surface above Gaussian centers, in their standard deviation (sigmas):
discs are drawn wider and nearer than they are (gsedit.bench.synthetic.splats.SINK over DISC)."""
MOST_ABOVE = 0.16
"""Largest standard deviation that counts for it, of the radius: wider ones are haze."""


def heights_from_above(
    scene: Gaussians, center: Vector, radius: float, up: Vector, ceiling: float
) -> Relief:
    """The heights of a scene around a point; what is above the ceiling is not there."""
    middle = center + (ceiling - 2 * radius - center @ up) * up  # the eye is at the ceiling
    place = Place(middle, up, perpendicular(up), 2 * radius, radius)
    below = scene.means.double() @ up <= ceiling
    seen = replace(scene, sh=scene.sh[:, :1])[below].detach()
    drawn = parallel_map(seen, place, up, CELLS)
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


DRAWN = 1.5
"""Standard deviations to which a Gaussian's part in the outline of an object reaches."""


def reach(body: Gaussians, up: Vector) -> tuple[float, float]:
    """The heights at which what is seen of an object begins and ends; without haze and strays."""
    body = body[_solid(body)]
    axes = rotation_matrices(body.quats.double()).mT @ up
    drawn = DRAWN * (axes * body.scales.double()).norm(dim=-1)
    heights = body.means.double() @ up
    return float(extents((heights - drawn)[:, None])[0]), float(
        extents((heights + drawn)[:, None])[1]
    )


def _solid(body: Gaussians) -> Bool[Tensor, " n"]:
    """Flag what is no haze; all where all is."""
    solid = body.opacities > SOLID
    return solid if bool(solid.any()) else torch.ones_like(solid)


MOST_POINTS = 8000
"""Points of an object that its support is searched with."""
LEVEL = 0.94
"""Least cosine between the upward direction and the normal of what carries: 20 degrees."""
HIDDEN, SUNK = 0.3, 0.1
"""Largest gap between an object and its support, of its height, and largest sinking: nobody saw the
underside of a ball, and a region seldom holds the lowest edge."""
BASE = 0.15
"""Part of the height, from below, that is over what carries an object."""
STEP = 0.25
"""Height above its foot, of its own, up to which something near an object may carry it."""
RANK = 0.8
"""Rank of the height that an object comes to lie on, of those under its base: stray leaves and
blades are higher."""
SOLID = 0.1
"""Opacity below which a Gaussian is haze, where there are others."""
STEPS = 200
"""Steps towards the farthest point by which the middle is found, to 0.5 %."""
AROUND = 1.3
"""Half the side of the map around an object, of the distance of its farthest point."""


@dataclass(frozen=True, eq=False)
class Stance:
    """An object on what carries it; world units, float64."""

    up: Vector
    """Normal of the surface under it, or the upward direction where none is."""
    foot: Vector
    """Point of that surface under its middle; of its lowest parts where none is."""
    height: float
    """Size along `up` from the foot."""
    stands: bool
    """Whether it touches a surface."""


def middle_of(body: Gaussians, up: Vector) -> Vector:
    """The middle of the smallest circle around an object's base, at half its height, float64.

    Sides that nobody saw have no Gaussians, and do not draw it away.
    """
    points = body.means[_solid(body)].double()
    rise = points @ up
    low, high = extents(rise[:, None])[:, 0]
    side = perpendicular(up)
    axes = torch.stack((side, torch.linalg.cross(up, side)))
    level = points[rise <= low + BASE * (high - low)] @ axes.T
    first, last = extents(level)
    level = level[((level >= first) & (level <= last)).all(1)] if len(level) > 3 else level
    middle = (first + last) / 2
    for i in range(STEPS if len(level) else 0):
        far = level[(level - middle).square().sum(1).argmax()]
        middle = middle + (far - middle) / (i + 2)
    return middle @ axes + (low + high) / 2 * up


def extents(points: Float[Tensor, "m d"]) -> Float[Tensor, "2 d"]:
    """Begin and end of points along each axis, stray ones left out."""
    return ends(points[:: 1 + len(points) // (1 << 20)], 0.01)


def size_of(body: Gaussians) -> float:
    """The diagonal of the box of an object, stray Gaussians left out."""
    low, high = extents(body.means.double())
    return max(float((high - low).norm()), float(body.log_scales.amax().exp()))


def stance_of(body: Gaussians, rest: Gaussians, up: Vector) -> Stance:
    """How an object stands in the rest of its scene; `up` is the scene's upward direction."""
    begins, last = reach(body, up)
    middle = middle_of(body, up)
    ceiling = begins + STEP * (last - begins)
    seen = map_around(body, rest, middle, up, ceiling)
    support = carrier(body, seen, up)
    base = body.means[body.means.double() @ up <= begins + BASE * (last - begins)]
    under = seen.tops[seen.under(base)]
    under = under[under.isfinite()]
    if support is not None and len(under):
        level, normal = float(under.quantile(RANK)), torch.from_numpy(support.normal)
        below = level - middle @ up - (support.offset - middle @ normal) / (normal @ up)
        if below > HOVERS * (last - begins):  # a rock's top, which is too small for a plane
            support = Plane(up.numpy(), level, support.band)
    if support is not None:
        normal = torch.from_numpy(support.normal)
        low, high = reach(body, normal)
        height = high - support.offset
        if -SUNK * height <= low - support.offset <= HIDDEN * height:
            foot = middle + (support.offset - middle @ normal) * normal
            return Stance(normal, foot, height, True)
    foot = middle + (begins - middle @ up) * up
    return Stance(up, foot, last - begins, False)


def map_around(
    body: Gaussians, rest: Gaussians, middle: Vector, up: Vector, ceiling: float
) -> Relief:
    """The heights of the rest of a scene around an object."""
    away = body.means.double() - middle
    level = away - (away @ up)[:, None] * up
    radius = AROUND * float(level.norm(dim=-1).amax().clamp_min(away.norm(dim=-1).amax() / 2))
    return heights_from_above(rest, middle, radius + 1e-9, up, ceiling)


def carrier(body: Gaussians, seen: Relief, up: Vector) -> Plane | None:
    """The plane that carries an object among what is seen from above around it; None: no such."""
    cells = seen.points[seen.there].numpy()
    chosen = body.means[:: 1 + len(body) // MOST_POINTS].double().numpy()
    if len(cells) < 3:
        return None
    points = np.concatenate((chosen, cells))
    ours = np.arange(len(points)) < len(chosen)
    found = find_support(points, ours, np.ones(len(points)), up.double().numpy())
    if found is None or float(found.normal @ up.numpy()) < LEVEL:
        return None
    return found
