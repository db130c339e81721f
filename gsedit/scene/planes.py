"""Planes in clouds of points: what most points are on, what an object stands on, what is around it.

`n` points, `v` of them voting, `k` planes; world units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.spatial import ConvexHull, QhullError

from gsedit.scene.neighbors import extent_of, k_nearest

VOTERS = 4000
"""Points that vote: more change no plane, and cost time."""
TOLERANCE = 0.01
"""Distance at which a point is on a plane around an object, of its extent."""
DEEPER = 2.0
"""Depth under a plane, in bands, down to which what lies there is a part of its surface."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane, normal . p = offset, and how thick the layer of points is that lies on it."""

    normal: Float64[np.ndarray, "3"]
    """Unit vector; what the plane was found for is on its side."""
    offset: float
    band: float
    """Distance up to which points belong to it: it is rough."""

    def heights(self, points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        return points.astype(np.float64) @ self.normal - self.offset

    def on(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points that belong to the plane."""
        return np.abs(self.heights(points)) < self.band

    def held(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points that a view of the plane from above shows: those on it, and right under
        it, as surfaces are not quite opaque."""
        heights = self.heights(points)
        return (heights < self.band) & (heights > -DEEPER * self.band)

    def facing(self, points: Float[np.ndarray, "n 3"]) -> Plane:
        """The plane with most of the points on its positive side."""
        return self.turned(self.normal * np.copysign(1.0, np.median(self.heights(points))))

    def turned(self, way: Float64[np.ndarray, "3"]) -> Plane:
        """The plane with its normal to the side that a direction points to."""
        side = np.copysign(1.0, self.normal @ way)
        return replace(self, normal=side * self.normal, offset=float(side * self.offset))


Votes = Callable[
    [Float64[np.ndarray, "k 3"], Float64[np.ndarray, " k"], Bool[np.ndarray, "v k"]],
    Float64[np.ndarray, " k"],
]
"""Share of the votes of each plane, from normals, offsets, and which of the voters are on it."""


def voted_plane(
    voters: Float64[np.ndarray, "v 3"],
    tolerance: float,
    random: np.random.Generator,
    votes_of: Votes | None = None,
    least: float = 0.0,
    width: float = 0.0,
    tries: int = 600,  # a sixth of the points on one plane give three
) -> tuple[Plane, float] | None:
    """The plane with most votes, fitted to the voters on it, and its share of them (RANSAC).

    A voter within `tolerance` is on a plane. Without `votes_of`, each plane has the votes of those.
    A plane has a `least` share and three voters, and those on it spread over a standard deviation
    of `width` across them; its band is their median distance. None where there is no such plane.
    """
    normals, offsets = planes_through(*voters[random.integers(len(voters), size=(3, tries))])
    on = np.abs(voters @ normals.T - offsets) < tolerance
    votes = on.mean(0) if votes_of is None else votes_of(normals, offsets, on)
    for best in np.argsort(-votes, kind="stable"):
        if votes[best] < max(least, 3 / len(voters)):
            return None
        if width and np.linalg.eigvalsh(np.cov(voters[on[:, best]].T))[1] <= width**2:
            continue
        normal, offset = refined_plane(voters, normals[best], float(offsets[best]), tolerance)
        away = np.abs(voters @ normal - offset)
        rough = float(np.median(away[away < tolerance]))
        return Plane(normal, offset, rough), float(votes[best])
    return None


def planes_through(
    a: Float64[np.ndarray, "t 3"], b: Float64[np.ndarray, "t 3"], c: Float64[np.ndarray, "t 3"]
) -> tuple[Float64[np.ndarray, "k 3"], Float64[np.ndarray, " k"]]:
    """(unit normals, offsets) of the planes through three points each that are not in a line."""
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    return normals, (normals * a[lengths > 0]).sum(1)


def refined_plane(
    points: Float64[np.ndarray, "n 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
    tolerance: float,
) -> tuple[Float64[np.ndarray, "3"], float]:
    """(unit normal on the same side, offset) fitted to the points within `tolerance` of a plane;
    at least three must be."""
    for _ in range(5):
        on = points[np.abs(points @ normal - offset) < tolerance]
        middle = on.mean(0)
        fitted = np.linalg.svd(on - middle, full_matrices=False)[2][2]
        normal = fitted * np.copysign(1.0, fitted @ normal)  # points in a line: also across it
        offset = float(normal @ middle)
    return normal, offset


NEAR = (0.15, 0.4)
"""How far the surroundings reach from an object, of its extent; the second where the first hold no
plane, for an object that hovers."""
LEAST_SPREAD = 0.08
"""Least standard deviation, across, of the points on it, of the object's extent: a strip a quarter
as wide as the object is long. What is narrower is another part of it, as a hand."""
ABOVE = 0.97
"""Least share of the object that is above the plane."""
TOUCHING, FOOT = 0.25, 0.005
"""Largest height of the object's foot over the plane, of its extent, and the share of the object
that is its foot: legs are thin."""
SLOPE = (0.42, 0.87)
"""Cosines between the normal and up of slopes: on less a thing hangs as on a wall, on more it
stands; between them it would slide (30 to 65 degrees)."""
LEVEL = 40
"""Power of the cosine between its normal and up in half of its votes: at 10 degrees, half of it."""
BAND = 3.0
"""Half of the thickness of a plane's layer of Gaussians, in its roughness."""
HOVERS = 0.05
"""Height of the object's lowest parts over a plane from which it stands on another, of its extent.
"""
OPEN = 0.5
"""Share of what is seen of a nearer plane from which more of the ground is seen within its hull
than within that of a slab."""


def find_support(
    points: Float[np.ndarray, "n 3"],
    object_: Bool[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
    up: Float64[np.ndarray, "3"] | None = None,
) -> Plane | None:
    """The plane of an object's surroundings that it stands on; None where there is none.

    The one wins that most of the weight near the object is on, of those that have it on one side;
    where the object hovers over that, as over the ground around a rock, a nearer one below it.
    With `up`, a unit vector, level ones count more.
    """
    extent = extent_of(points[object_])
    ground = _voted_support(points, object_, weights, up)
    if ground is None or (height := _lowest(ground, points[object_])) < HOVERS * extent:
        return ground
    layer = _layer(ground, BAND, TOLERANCE * extent).on(points)
    nearer = _voted_support(points, object_, np.where(layer, 0.0, weights), up)
    if nearer is None or _lowest(nearer, points[object_]) > height:
        return ground
    return ground if _is_open(nearer, layer, points, object_, weights) else nearer


def _lowest(plane: Plane, body: Float[np.ndarray, "m 3"]) -> float:
    """Height of an object's lowest parts over a plane."""
    return float(np.quantile(plane.heights(body), 0.03))


def _is_open(
    plane: Plane,
    below: Bool[np.ndarray, " n"],
    points: Float[np.ndarray, "n 3"],
    object_: Bool[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
) -> bool:
    """Whether what is `below` is seen between the parts of a plane near an object, as between the
    beams of a table: it is no surface that something stands on."""
    extent = extent_of(points[object_])
    flat = points @ np.linalg.svd(plane.normal[None])[2][1:].T
    near = np.isfinite(k_nearest(points[object_], points, 1, NEAR[0] * extent)[0][:, 0])
    on = np.flatnonzero(near & ~object_ & (weights > 0) & plane.on(points))
    try:
        sides = ConvexHull(flat[on]).equations
    except QhullError:
        return False
    within = (flat[below] @ sides[:, :2].T + sides[:, 2] <= 0).all(1)
    return bool(weights[below][within].sum() > OPEN * weights[on].sum())


def _voted_support(
    points: Float[np.ndarray, "n 3"],
    object_: Bool[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
    up: Float64[np.ndarray, "3"] | None,
) -> Plane | None:
    """The plane that most of the weight near an object is on and that has it on one side."""
    points = points.astype(np.float64)
    body = points[object_]
    extent = extent_of(body)
    tolerance = TOLERANCE * extent
    random = np.random.default_rng(0)
    some = body[random.integers(len(body), size=VOTERS)]

    def votes(normals: np.ndarray, offsets: np.ndarray, on: np.ndarray) -> np.ndarray:
        heights = some @ normals.T - offsets
        heights *= np.copysign(1.0, np.median(heights, axis=0))
        lowest, foot = np.quantile(heights, (1 - ABOVE, FOOT), axis=0)
        carrying = (lowest >= -tolerance) & (foot <= TOUCHING * extent)
        upright = np.ones(len(normals)) if up is None else np.abs(normals @ up)
        level = upright**LEVEL
        carrying &= (upright < SLOPE[0]) | (upright > SLOPE[1])
        return np.where(carrying, on.mean(0) * (1 + level) / 2, 0.0)

    for near in NEAR:
        close = np.isfinite(k_nearest(body, points, 1, near * extent)[0][:, 0])
        ring = np.flatnonzero(close & ~object_ & (weights > 0))
        if not len(ring):
            continue
        share = weights[ring] / weights[ring].sum()
        voters = points[random.choice(ring, VOTERS, p=share)]  # by weight: one vote each
        width = LEAST_SPREAD * extent
        found = voted_plane(voters, tolerance, random, votes, 0.1, width)
        if found is not None:
            plane = found[0].facing(some)
            return replace(plane, band=max(plane.band, 0.0025 * extent))  # a toe is higher
    return None


LEAST_SHARE = 0.15
"""Least share of the surroundings that is on a plane beyond the first."""
SMALLEST = 1e-3
"""Least extent of an object, of its scene's: one Gaussian has none."""
ALONG = 0.7
"""Least mean cosine between the normals of its Gaussians and a plane beyond the first: those that
it cuts across have 0.5."""
PARALLEL, LAYERS = 0.97, 2.0
"""Cosine of planes that are parallel, and the distance of two layers of one, in their bands."""


def find_planes(
    points: Float[np.ndarray, "n 3"],
    removed: Bool[np.ndarray, " n"],
    axes: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"],
    eye: Float64[np.ndarray, "3"],
    up: Float64[np.ndarray, "3"],
) -> tuple[Plane, ...]:
    """The planes around an object, the one it stands on first; `weights` of its surroundings.

    `eye`, the middle of the cameras, is on their positive side; `up` is the scene's; `axes` are
    the shortest axes, as long as a Gaussian is flat.
    """
    extent = max(extent_of(points[removed]), SMALLEST * extent_of(points))
    tolerance = TOLERANCE * extent
    support = find_support(points, removed, weights, up)
    found = [] if support is None else [_layer(support, BAND, tolerance).facing(eye[None])]
    left = np.flatnonzero((weights > 0) & ~removed)
    left = left[~np.any([p.on(points[left]) for p in found], 0)] if found else left
    random = np.random.default_rng(0)
    total = weights[~removed].sum()
    for _ in range(4):  # a support and the walls of a corner
        if len(left) <= 3:
            break
        asked = random.choice(left, VOTERS, p=weights[left] / weights[left].sum())
        voters = points[asked].astype(np.float64)
        voted = voted_plane(voters, tolerance, random)
        if voted is None or voted[1] * weights[left].sum() < LEAST_SHARE * total:
            break
        plane = _layer(voted[0], BAND, tolerance).facing(eye[None])
        flat = axes[asked][plane.on(voters)]
        if np.abs(flat @ plane.normal).sum() > ALONG * np.linalg.norm(flat, axis=1).sum():
            _put(found, plane)  # else it cuts across surfaces
        left = left[~plane.on(points[left])]
    return tuple(found)


def _layer(plane: Plane, thick: float, least: float) -> Plane:
    """A plane with a band so many times as thick as it is rough."""
    return replace(plane, band=max(thick * plane.band, least))


def _put(found: list[Plane], plane: Plane) -> None:
    """Add a plane, or widen the one that it is another layer of: soil under grass."""
    for index, one in enumerate(found):
        apart = abs(plane.offset - one.offset)
        if one.normal @ plane.normal > PARALLEL and apart < LAYERS * (one.band + plane.band):
            found[index] = replace(one, band=max(one.band, apart + plane.band))
            return
    found.append(plane)
