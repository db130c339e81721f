"""Level patches of a scene, that things stand on, with their planes; and its walls.

`n` Gaussians; world units.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import ConvexHull, QhullError

from gsedit.scene.neighbors import linked
from gsedit.scene.planes import VOTERS, Plane, voted_plane
from gsedit.select.surfaces import Surfaces

LEVEL = cos(radians(30))
"""Least cosine between the normal of level ground and up: rough ground varies."""
STEEPEST = 0.5
"""Slope between two neighbors from which they are not of one patch."""
MOST_PATCHES = 48
"""Patches that something may stand on, the largest ones."""
LEAST_AREA = 0.001
"""Least area of such a patch, of the largest one's."""
LEAST_ROWS = 12
"""Least Gaussians of a patch."""
COPLANAR = 0.01
"""Height between two patches in one plane, of the square root of the larger one's area."""
SEEN = 1e-3
"""Least pixels that a Gaussian of a patch gives: the backs of things have no sure normals."""
ABOVE = 3.0
"""Height above a patch from which something stands on it, of its roughness."""
HULL_MARGIN = 0.1
"""Width around the hull of a patch that counts as over it, of the square root of its area."""

FACING = cos(radians(25))
"""Least cosine between the normal of a wall and those of its Gaussians."""
WALLS = 6
"""Most walls, and a ceiling."""
WALL_SIZE = 0.5
"""Least width of a wall, of the radius of the place: its standard deviations times 3.5."""
WALL_SHARE = 0.08
"""Least share of the area of all that is not level that is of a wall."""
SKIRT = 0.6
"""Distance of rims before the plane of the ground or a wall, in distances between its Gaussians."""
BEHIND = 0.03
"""Largest share of the other things that is behind a wall."""
THIN = 0.01
"""Distance from a wall's plane that is still of it, of the radius of the place."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A connected level patch and the plane through it."""

    rows: Int[np.ndarray, " m"]
    normal: Float64[np.ndarray, "3"]
    """Unit vector, turned upward."""
    offset: float
    rough: float
    """Median distance of the patch from its plane."""
    area: float
    outline: Float64[np.ndarray, "f 3"]
    """Lines around its hull in the plane: a x + b y + c <= 0 inside."""
    axes: Float64[np.ndarray, "2 3"]
    """Unit vectors along the plane, of x and y."""

    def heights(self, points: Float64[np.ndarray, "k 3"]) -> Float64[np.ndarray, " k"]:
        """Signed distances from the plane, positive above."""
        return points @ self.normal - self.offset

    def above(self, points: Float64[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
        """Flag the points that are no more of the patch, but of what is above it."""
        return self.heights(points) > ABOVE * self.rough

    def over(
        self, points: Float64[np.ndarray, "k 3"], margin: float = HULL_MARGIN
    ) -> Bool[np.ndarray, " k"]:
        """Flag the points over or under the hull of the patch, with a margin; without the rim
        where it is negative."""
        flat = points @ self.axes.T
        beyond = flat @ self.outline[:, :2].T + self.outline[:, 2]
        return beyond.max(1, initial=-np.inf) <= margin * np.sqrt(self.area)


def level_patches(surfaces: Surfaces, among: Bool[np.ndarray, " n"]) -> list[Patch]:
    """The level patches of what is `among`, the largest first."""
    level = among & surfaces.solid & (surfaces.seen > SEEN) & (surfaces.upright > LEVEL)
    pairs = surfaces.edges
    pairs = pairs[level[pairs[:, 0]] & level[pairs[:, 1]]]
    apart = surfaces.points[pairs[:, 0]] - surfaces.points[pairs[:, 1]]
    rise = np.abs(apart @ surfaces.up)
    pairs = pairs[rise <= STEEPEST * np.linalg.norm(apart, axis=1)]
    number = numbered(linked(pairs, len(surfaces)), level)
    rows = np.flatnonzero(level)
    area = np.bincount(number[rows], weights=surfaces.areas[rows])
    count = np.bincount(number[rows])
    largest = np.argsort(-area, kind="stable")[:MOST_PATCHES]
    kept = [i for i in largest if area[i] >= LEAST_AREA * area.max() and count[i] >= LEAST_ROWS]
    found = [_patch(surfaces, rows[number[rows] == i]) for i in kept]
    return _merged(surfaces, [each for each in found if each is not None])


def _merged(surfaces: Surfaces, patches: list[Patch]) -> list[Patch]:
    """The patches, those in one plane and over one hull as one: things lie across them."""
    links = [np.zeros((0, 2), np.int64)]
    for i, each in enumerate(patches):
        for j in range(i + 1, len(patches)):
            points = surfaces.points[patches[j].rows]
            off = np.abs(np.median(each.heights(points)))
            if (
                off <= max(2 * each.rough, COPLANAR * np.sqrt(each.area))
                and each.over(points).any()
            ):
                links.append(np.array([[i, j]]))
    group = linked(np.concatenate(links), len(patches))
    rows = [
        np.concatenate([p.rows for p, g in zip(patches, group) if g == one])
        for one in dict.fromkeys(group)
    ]
    found = [_patch(surfaces, np.sort(each)) for each in rows]
    return sorted((p for p in found if p is not None), key=lambda p: -p.area)


def _patch(surfaces: Surfaces, rows: Int[np.ndarray, " m"]) -> Patch | None:
    """The patch of these rows; None for a strip or a stack."""
    points = surfaces.points[rows]
    middle = np.median(points, axis=0)
    fitted = np.linalg.svd(points - middle, full_matrices=False)[2]
    normal = fitted[2] * np.sign(fitted[2] @ surfaces.up or 1)
    if normal @ surfaces.up < LEVEL:
        return None
    distance = points @ normal
    offset = float(np.median(distance))
    try:
        outline = ConvexHull(points @ fitted[:2].T).equations
    except QhullError:
        return None
    rough = float(np.median(np.abs(distance - offset)))
    return Patch(
        rows, normal, offset, rough, float(surfaces.areas[rows].sum()), outline, fitted[:2]
    )


def walls(surfaces: Surfaces, among: Bool[np.ndarray, " n"]) -> list[Int[np.ndarray, " m"]]:
    """The rows of each wall or ceiling: large planes with hardly anything behind them."""
    random, found = np.random.default_rng(0), []
    left = among & surfaces.solid & (surfaces.upright < LEVEL)
    tolerance = THIN * surfaces.place.radius
    total = surfaces.areas[left].sum()
    for _ in range(WALLS):
        rows = np.flatnonzero(left)
        if len(rows) < LEAST_ROWS or not surfaces.areas[rows].sum():
            break
        share = surfaces.areas[rows] / surfaces.areas[rows].sum()
        voters = random.choice(rows, VOTERS, p=share)
        plane = _best_wall(surfaces, voters, tolerance, random)
        if plane is None:
            break
        on = rows[_on_plane(surfaces, rows, plane, 2 * tolerance)]
        if surfaces.areas[on].sum() < WALL_SHARE * total:
            break
        behind = _wall(surfaces, on, among, tolerance)
        if behind is not None:
            found.append(np.flatnonzero(behind))
            left &= ~behind
        left[on] = False
    return found


def _best_wall(
    surfaces: Surfaces,
    voters: Int[np.ndarray, " v"],
    tolerance: float,
    random: np.random.Generator,
) -> Plane | None:
    """The steep or hanging plane with most voters that face along it."""

    def votes(normals: np.ndarray, offsets: np.ndarray, on: np.ndarray) -> np.ndarray:
        rise = np.abs(normals @ surfaces.up)
        facing = np.abs(surfaces.normals[voters] @ normals.T) > FACING
        return np.where((rise < 0.3) | (rise > LEVEL), (on & facing).mean(0), 0.0)

    found = voted_plane(surfaces.points[voters], tolerance, random, votes)
    return None if found is None else found[0]


def _on_plane(
    surfaces: Surfaces,
    rows: Int[np.ndarray, " m"],
    plane: Plane,
    tolerance: float,
) -> Bool[np.ndarray, " m"]:
    """Flag the rows that are on a plane and face along its normal, either way."""
    near = np.abs(plane.heights(surfaces.points[rows])) < tolerance
    return near & (np.abs(surfaces.normals[rows] @ plane.normal) > FACING)


def _wall(
    surfaces: Surfaces, rows: Int[np.ndarray, " m"], among: Bool[np.ndarray, " n"], tolerance: float
) -> Bool[np.ndarray, " n"] | None:
    """The Gaussians of a wall and behind it; None for a plane that is small or before things."""
    points = surfaces.points[rows]
    middle = points.mean(0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    widths = 3.5 * spread[:2] / np.sqrt(len(rows))
    if widths.min() < WALL_SIZE * surfaces.place.radius:
        return None
    normal = axes[2] * np.sign((surfaces.normals[rows] @ axes[2]).sum() or 1)
    before = (surfaces.points - middle) @ normal
    others = among.copy()
    others[rows] = False
    seen = surfaces.seen * others
    if seen[before < -3 * tolerance].sum() > BEHIND * seen.sum():
        return None
    spacing = float(np.sqrt(np.median(surfaces.areas[rows])))
    high = surfaces.heights > np.median(surfaces.heights[rows])
    held = among & (before < SKIRT * spacing) & (high | (surfaces.upright < LEVEL))
    held[rows] = True
    return held


def numbered(labels: Int[np.ndarray, " n"], among: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The labels of the rows `among`, counted from 0 without gaps; -1 elsewhere."""
    out = np.full(len(labels), -1)
    if among.any():
        out[among] = np.unique(labels[among], return_inverse=True)[1].reshape(-1)
    return out


def joints_of(
    pairs: Int[np.ndarray, "e 2"], count: int, often: Int[np.ndarray, " e"] | None = None
) -> tuple[Int[np.ndarray, "j 2"], Int[np.ndarray, " j"]]:
    """The pairs of different numbers below `count`, the lower first, and how often each is: once
    for each time it is among the pairs, or as `often` as is given."""
    low, high = np.minimum(*pairs.T), np.maximum(*pairs.T)
    apart = low != high
    keys = (low * count + high)[apart]
    if often is None:
        keys, times = np.unique(keys, return_counts=True)
    else:
        keys, at = np.unique(keys, return_inverse=True)
        times = np.bincount(at.reshape(-1), often[apart], len(keys)).astype(np.int64)
    return np.stack((keys // count, keys % count), 1), times
