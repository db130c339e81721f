"""Bodies of a scene, told apart by the level patches that they stand on.

A body that touches a patch from below carries it; one that touches it only from above stands on it.

`n` Gaussians, `b` bodies, `p` patches, `e` pairs of neighbors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from gsedit.scene.neighbors import linked
from gsedit.select.layers import LEVEL, SKIRT, Patch, joints_of, level_patches, numbered, walls
from gsedit.select.surfaces import Surfaces

GROUND_SHARE = 0.05
"""Least area of a further patch of the ground, of the largest one's."""
GROUND_BAND = 0.04
"""Height, in radii of the place, over which such patches may differ."""
GROUND_AREA, GROUND_LEVEL = 0.05, 0.2
"""Least area of the ground, of that of all that is near; or of what is level there: where a street
or trees are near, all areas together are those of noise."""
GROUND_SEEN = 0.02
"""Least share of what is seen near the place that is of the ground."""
AS_WIDE = 0.3
"""Least area of the lowest patch for it to be the ground, of the largest that could be."""
BELOW = 0.3
"""Largest share of what is seen near the place that is below the ground."""
CARRIES = 0.25
"""Least share of the neighbors between a body and a patch where the body is below it, for the
body to carry the patch."""
LEAST_TOUCH = 3
"""Least pairs of neighbors that are a touch."""
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


@dataclass(frozen=True, eq=False)
class Stacks:
    """The kind of each Gaussian near the place that is looked at."""

    body: Int[np.ndarray, " n"]
    """Connected part with the patches that it carries; -1: none."""
    ground: Bool[np.ndarray, " n"]
    """Whether it is of the ground, or under it."""
    wall: Int[np.ndarray, " n"]
    """Wall or ceiling; -1: none."""


def find_stacks(surfaces: Surfaces, near: Bool[np.ndarray, " n"]) -> Stacks:
    """Ground, walls and bodies of what is `near`."""
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
    return Stacks(_bodies(surfaces, loose, patch, patches), ground, wall)


def _ground(
    surfaces: Surfaces, patches: list[Patch], among: Bool[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], list[Patch]]:
    """The Gaussians of the ground or below it, and the other patches."""
    ground = np.zeros(len(surfaces), bool)
    able = [each for each in patches if _is_ground(surfaces, each, among)]
    if not able:
        return ground, patches
    wide = [each for each in able if each.area >= AS_WIDE * max(p.area for p in able)]
    main = min(wide, key=lambda each: float(np.median(surfaces.heights[each.rows])))
    others = []
    band = GROUND_BAND * surfaces.place.radius
    ground[main.rows] = True
    for each in (one for one in patches if one is not main):
        off = abs(float(np.median(main.heights(surfaces.points[each.rows]))))
        if off < 3 * main.rough or (off < band and each.area > GROUND_SHARE * main.area):
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
    if seen[patch.rows].sum() < GROUND_SEEN * seen.sum():
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
        carries = np.flatnonzero(carries & (total >= LEAST_TOUCH))
        links.append(np.stack((carries, np.full(len(carries), count + i)), 1))
        joints, times = joints_of(body[cut[through == i]], count)
        upper = np.where(lower[joints].argmin(1) == 0, joints[:, 0], joints[:, 1])
        links.append(joints[times >= GROWN * (times + total[upper])])
    return np.concatenate(links).astype(np.int64)
