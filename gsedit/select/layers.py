"""Level patches of a scene, that things stand on, with their planes; its walls, and its bodies.

A body that touches a patch from below carries it; one that touches it only from above stands on it.
`n` Gaussians, `e` pairs of neighbors; world units.
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
LEAST_ROWS = 12
"""Least Gaussians of a patch."""

SEEN = 1e-3
"""Least pixels that a Gaussian of a patch gives: the backs of things have no sure normals."""
HULL_MARGIN = 0.1
"""Width around the hull of a patch that counts as over it, of the square root of its area."""
FACING = cos(radians(25))
"""Least cosine between the normal of a wall and those of its Gaussians."""
SKIRT = 0.6
"""Distance of rims before the plane of the ground or a wall, in distances between its Gaussians."""


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
        return self.heights(points) > 3.0 * self.rough

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
    pairs = pairs[rise <= 0.5 * np.linalg.norm(apart, axis=1)]  # steeper ones are of two patches
    number = numbered(linked(pairs, len(surfaces)), level)
    rows = np.flatnonzero(level)
    area = np.bincount(number[rows], weights=surfaces.areas[rows])
    count = np.bincount(number[rows])
    largest = np.argsort(-area, kind="stable")[:48]
    kept = [i for i in largest if area[i] >= 0.001 * area.max() and count[i] >= LEAST_ROWS]
    found = [_patch(surfaces, rows[number[rows] == i]) for i in kept]
    return _merged(surfaces, [each for each in found if each is not None])


def _merged(surfaces: Surfaces, patches: list[Patch]) -> list[Patch]:
    """The patches, those in one plane and over one hull as one: things lie across them."""
    links = [np.zeros((0, 2), np.int64)]
    for i, each in enumerate(patches):
        for j in range(i + 1, len(patches)):
            points = surfaces.points[patches[j].rows]
            off = np.abs(np.median(each.heights(points)))
            if off <= max(2 * each.rough, 0.01 * np.sqrt(each.area)) and each.over(points).any():
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
    tolerance = 0.01 * surfaces.place.radius
    total = surfaces.areas[left].sum()
    for _ in range(6):  # walls and a ceiling
        rows = np.flatnonzero(left)
        if len(rows) < LEAST_ROWS or not surfaces.areas[rows].sum():
            break
        share = surfaces.areas[rows] / surfaces.areas[rows].sum()
        voters = random.choice(rows, VOTERS, p=share)
        plane = _best_wall(surfaces, voters, tolerance, random)
        if plane is None:
            break
        on = rows[np.abs(plane.heights(surfaces.points[rows])) < 2 * tolerance]
        on = on[np.abs(surfaces.normals[on] @ plane.normal) > FACING]  # either way
        if surfaces.areas[on].sum() < 0.08 * total:
            break
        behind = _wall(surfaces, on, among, tolerance)
        if behind is not None:
            found.append(np.flatnonzero(behind))
            left &= ~behind
        left[on] = False
    return found


def _best_wall(
    surfaces: Surfaces, voters: Int[np.ndarray, " v"], tolerance: float, random: np.random.Generator
) -> Plane | None:
    """The steep or hanging plane with most voters that face along it."""

    def votes(normals: np.ndarray, offsets: np.ndarray, on: np.ndarray) -> np.ndarray:
        rise = np.abs(normals @ surfaces.up)
        facing = np.abs(surfaces.normals[voters] @ normals.T) > FACING
        return np.where((rise < 0.3) | (rise > LEVEL), (on & facing).mean(0), 0.0)

    found = voted_plane(surfaces.points[voters], tolerance, random, votes)
    return None if found is None else found[0]


def _wall(
    surfaces: Surfaces, rows: Int[np.ndarray, " m"], among: Bool[np.ndarray, " n"], tolerance: float
) -> Bool[np.ndarray, " n"] | None:
    """The Gaussians of a wall and behind it; None for a plane that is small or before things."""
    points = surfaces.points[rows]
    middle = points.mean(0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    widths = 3.5 * spread[:2] / np.sqrt(len(rows))
    if widths.min() < 0.5 * surfaces.place.radius:  # too narrow for a wall
        return None
    normal = axes[2] * np.sign((surfaces.normals[rows] @ axes[2]).sum() or 1)
    before = (surfaces.points - middle) @ normal
    others = among.copy()
    others[rows] = False
    seen = surfaces.seen * others
    if seen[before < -3 * tolerance].sum() > 0.03 * seen.sum():  # things are behind it
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


# ---- bodies, told apart by the level patches that they stand on ---------------------------------

GROUND_BAND = 0.04
"""Height, in radii of the place, over which such patches may differ."""
GROUND_AREA, GROUND_LEVEL = 0.05, 0.2
"""Least area of the ground, of that of all that is near; or of what is level there: where a street
or trees are near, all areas together are those of noise."""
BELOW = 0.3
"""Largest share of what is seen near the place that is below the ground."""
CARRIES = 0.25
"""Least share of the neighbors between a body and a patch where the body is below it, for the
body to carry the patch."""
GROWN = 0.45
"""Least share of the smooth joints of two bodies above and below a patch, beside what joins the
upper one with the patch, for them to be one: the back of a chair goes through the plane of its
seat."""
GOES_ON = 0.5
"""Least share of smooth joints between a body and a patch that is a part of it, as the foot of a
lamp; what stands on a patch meets it in a crease."""
FLUSH, FLUSH_FACING = 0.35, 0.8
"""Largest slope between two neighbors, and least cosine between their normals, on one smooth
surface."""


def find_stacks(
    surfaces: Surfaces, near: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The body of each Gaussian that is `near`, with the patches that it carries (-1: none);
    whether it is of the ground or under it; and its wall or ceiling (-1: none)."""
    wall = np.full(len(surfaces), -1)
    for i, rows in enumerate(walls(surfaces, near)):
        wall[rows] = i
    left = near & (wall < 0)
    patches = level_patches(surfaces, left)
    ground, patches = _ground(surfaces, patches, near)
    wall[ground] = -1
    patch = np.full(len(surfaces), -1)
    for i, each in enumerate(patches):
        patch[each.rows] = i
    patch[ground] = -1
    loose = left & (patch < 0) & ~ground & surfaces.solid
    return _bodies(surfaces, loose, patch, patches), ground, wall


def _ground(
    surfaces: Surfaces, patches: list[Patch], among: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], list[Patch]]:
    """The Gaussians of the ground or below it, and the other patches."""
    ground = np.zeros(len(surfaces), bool)
    able = [each for each in patches if _is_ground(surfaces, each, among)]
    if not able:
        return ground, patches
    wide = [each for each in able if each.area >= 0.3 * max(p.area for p in able)]
    main = min(wide, key=lambda each: float(np.median(surfaces.heights[each.rows])))
    others = []
    band = GROUND_BAND * surfaces.place.radius
    ground[main.rows] = True
    for each in (one for one in patches if one is not main):
        off = abs(float(np.median(main.heights(surfaces.points[each.rows]))))
        if off < 3 * main.rough or (off < band and each.area > 0.05 * main.area):
            ground[each.rows] = True
        else:
            others.append(each)
    spacing = float(np.sqrt(main.area / len(main.rows)))
    ground |= among & (main.heights(surfaces.points) < SKIRT * spacing)
    return ground, others


def _is_ground(surfaces: Surfaces, patch: Patch, among: Bool[np.ndarray, " n"]) -> bool:
    """Whether a patch is wide, and most of what is seen is on it or above it."""
    level = among & surfaces.solid & (surfaces.upright > LEVEL)
    wide = min(
        GROUND_AREA * surfaces.areas[among].sum(), GROUND_LEVEL * surfaces.areas[level].sum()
    )
    if patch.area < wide:
        return False
    seen = surfaces.seen * among
    if seen[patch.rows].sum() < 0.02 * seen.sum():
        return False
    below = patch.heights(surfaces.points) < -3 * patch.rough - GROUND_BAND * surfaces.place.radius
    return bool(seen[below].sum() < BELOW * seen.sum())


def _bodies(
    surfaces: Surfaces,
    loose: Bool[np.ndarray, " n"],
    patch: Int[np.ndarray, " n"],
    patches: list[Patch],
) -> Int[np.ndarray, " n"]:
    """Connected parts of what is loose, cut along the patches, with the patches they carry."""
    pairs = surfaces.edges
    within = pairs[loose[pairs[:, 0]] & loose[pairs[:, 1]]]
    through = np.full(len(within), -1)
    for i, each in enumerate(patches):
        through[crossing(surfaces, within, each, each.heights(surfaces.points) > each.rough)] = i
    body = numbered(linked(within[through < 0], len(surfaces)), loose)
    through[~flush(surfaces, within)] = -1
    links = _links(surfaces, body, patch, patches, within[through >= 0], through[through >= 0])
    count = int(body.max()) + 1
    held = (body >= 0) | (patch >= 0)
    joined = linked(links, max(count + len(patches), 1))
    one = np.where(body >= 0, body, count + patch)
    return numbered(joined[np.where(held, one, 0)], held)


def crossing(
    surfaces: Surfaces, pairs: Int[np.ndarray, "e 2"], patch: Patch, side: Bool[np.ndarray, " n"]
) -> Int[np.ndarray, " c"]:
    """The pairs over the hull of a patch that go from one side of its plane to the other."""
    across = np.flatnonzero(side[pairs[:, 0]] != side[pairs[:, 1]])
    middles = surfaces.points[pairs[across]].mean(1)
    return across[patch.over(middles)] if len(across) else across


def flush(surfaces: Surfaces, pairs: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
    """Flag the pairs on one smooth surface: it goes on from one to the other."""
    first, second = pairs.T
    apart = surfaces.points[first] - surfaces.points[second]
    reach = FLUSH * np.linalg.norm(apart, axis=1)
    a, b = surfaces.normals[first], surfaces.normals[second]
    alike = (a * b).sum(1) > FLUSH_FACING
    return alike & (np.abs((apart * a).sum(1)) < reach) & (np.abs((apart * b).sum(1)) < reach)


def _links(
    surfaces: Surfaces,
    body: Int[np.ndarray, " n"],
    patch: Int[np.ndarray, " n"],
    patches: list[Patch],
    cut: Int[np.ndarray, "c 2"],
    through: Int[np.ndarray, " c"],
) -> Int[np.ndarray, "l 2"]:
    """Bodies and patches (numbered after the bodies) that are one."""
    count, links = int(body.max()) + 1, [np.zeros((0, 2), np.int64)]
    pairs = surfaces.edges
    both = np.concatenate((pairs, pairs[:, ::-1]))
    both = both[(body[both[:, 0]] >= 0) & (patch[both[:, 1]] >= 0)]
    smooth = flush(surfaces, both)
    for i, each in enumerate(patches):
        on = patch[both[:, 1]] == i
        touching = both[on, 0]
        under = each.heights(surfaces.points[touching]) <= 0
        total, below, goes_on = (
            np.bincount(body[touching], weights=weights, minlength=count)
            for weights in (np.ones(len(touching)), under, smooth[on])
        )
        lower = below / np.maximum(total, 1)
        carries = (lower >= CARRIES) | (goes_on >= GOES_ON * total)
        carries = np.flatnonzero(carries & (total >= 3))  # fewer pairs are no touch
        links.append(np.stack((carries, np.full(len(carries), count + i)), 1))
        joints, times = joints_of(body[cut[through == i]], count)
        upper = np.where(lower[joints].argmin(1) == 0, joints[:, 0], joints[:, 1])
        links.append(joints[times >= GROWN * (times + total[upper])])
    return np.concatenate(links).astype(np.int64)
