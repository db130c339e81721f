"""Bodies of a scene, told apart by the level patches that they stand on, and their pieces by color.

A body that touches a patch from below carries it; one that touches it only from above stands on it.
Bodies of several objects that touch are told apart by their pieces. `n` Gaussians, `m` of them in a
body, `b` bodies, `p` patches, `c` small groups, `e` pairs of neighbors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

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


# ---- pieces by color ----------------------------------------------------------------------------

CELL = 4.0
"""Side of the cells in which Gaussians are grouped first, in distances between neighbors."""
GROUPED = 0.3
"""Least affinity of two neighbors of one group."""
SAME_COLOR = 0.16
"""Largest difference of the mean colors (RMS over the channels) of pieces that are joined."""
LEAST_PIECE = 0.03
"""Least share of the body's Gaussians that is a piece of its own."""
ROUNDS = 60
"""Most rounds of joining; each joins all pairs that are each other's nearest."""
NECK = 2.5
"""Most pairs of neighbors between two things that only touch, in square roots of the smaller's
Gaussians: a patch of color that lies in another has more around it."""
LEAST_FOOT = 3
"""Least pairs of neighbors between a piece and what it stands on."""


def pieces(surfaces: Surfaces, inside: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The number, from 0, of the piece of about one color each Gaussian inside is in; -1: none."""
    pairs, alike = _pairs_within(surfaces, inside)
    if not inside.any():
        return np.full(len(inside), -1)
    side = CELL * float(np.sqrt(np.median(surfaces.areas[inside]))) or 1.0
    cells = np.floor(surfaces.points / side).astype(np.int64)
    together = (cells[pairs[:, 0]] == cells[pairs[:, 1]]).all(1) & (alike > GROUPED)
    group = numbered(linked(pairs[together], len(inside)), inside)
    piece = _joined(surfaces.colors[inside], group[inside], group[pairs])
    out = np.full(len(inside), -1)
    out[inside] = piece
    return out


def split_touching(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], support: Bool[np.ndarray, " n"]
) -> list[Bool[np.ndarray, " n"]]:
    """The things of a body that each stand on the support and only touch; itself if it is one."""
    piece = pieces(surfaces, inside)
    count = int(piece.max()) + 1
    if count < 2:
        return [inside]
    pairs, _ = _pairs_within(surfaces, inside)
    sizes = np.bincount(piece[inside], minlength=count)
    group = np.arange(count)
    touches = surfaces.touches(inside, support)[inside]
    feet = np.bincount(piece[inside], touches, count)
    while True:
        size = np.bincount(group, weights=sizes, minlength=count)
        foot = np.bincount(group, weights=feet, minlength=count)
        joints, times = joints_of(group[piece[pairs]], count)
        if not len(joints):
            break
        narrow = times / np.sqrt(np.minimum(size[joints[:, 0]], size[joints[:, 1]]))
        hangs = foot[joints].min(1) < LEAST_FOOT
        narrow[hangs] += 1000  # what does not stand is of what it hangs on, most of all
        best = int(narrow.argmax())
        if narrow[best] < NECK:
            break
        group[group == joints[best, 1]] = joints[best, 0]
    numbers = np.unique(group)
    return [inside & np.isin(piece, np.flatnonzero(group == each)) for each in numbers]


def _pairs_within(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, "e 2"], Float64[np.ndarray, " e"]]:
    pairs = surfaces.edges
    keep = inside[pairs[:, 0]] & inside[pairs[:, 1]]
    return pairs[keep], surfaces.alike[keep]


@dataclass(frozen=True, eq=False)
class _Groups:
    """Groups of Gaussians, and which of them are neighbors."""

    sizes: Float64[np.ndarray, " c"]
    sums: Float64[np.ndarray, "c 3"]
    """Sums of their colors."""
    joints: Int[np.ndarray, "j 2"]
    """Groups that are neighbors, the lower first."""
    times: Int[np.ndarray, " j"]
    """Pairs of neighbors between them."""

    @property
    def apart(self) -> Float64[np.ndarray, " j"]:
        """Difference of the mean colors of groups that are neighbors, RMS over the channels."""
        mean = self.sums / self.sizes[:, None]
        return np.sqrt(np.square(mean[self.joints[:, 0]] - mean[self.joints[:, 1]]).mean(1))

    def joined(self, to: Int[np.ndarray, " c"]) -> _Groups:
        """The groups that these become; `to` are their numbers."""
        count = int(to.max()) + 1
        joints, times = joints_of(to[self.joints], count, self.times)
        sizes = np.bincount(to, weights=self.sizes, minlength=count)
        return _Groups(sizes, _summed(self.sums, to, count), joints, times)


def _summed(
    values: Float64[np.ndarray, "m 3"], number: Int[np.ndarray, " m"], count: int
) -> Float64[np.ndarray, "c 3"]:
    return np.stack([np.bincount(number, weights=c, minlength=count) for c in values.T], 1)


def _joined(
    colors: Float64[np.ndarray, "m 3"], group: Int[np.ndarray, " m"], pairs: Int[np.ndarray, "e 2"]
) -> Int[np.ndarray, " m"]:
    """The piece of each row, from the groups and the pairs of groups that are neighbors."""
    count = int(group.max()) + 1
    sizes = np.bincount(group, minlength=count).astype(np.float64)
    groups = _Groups(sizes, _summed(colors, group, count), *joints_of(pairs, count))
    for _ in range(ROUNDS):  # by color
        cost = groups.apart
        able = cost < SAME_COLOR
        links = _mutual(groups.joints[able], cost[able], len(groups.sizes))
        if not len(links):
            break
        to = linked(links, len(groups.sizes))
        group, groups = to[group], groups.joined(to)
    for _ in range(ROUNDS):  # the small ones with what is most like them, or most around them
        small = groups.sizes < LEAST_PIECE * len(group)
        cost = (groups.apart + SAME_COLOR) / groups.times
        links = _of_the_small(groups.joints, cost, small)
        if not len(links):
            break
        to = linked(links, len(groups.sizes))
        group, groups = to[group], groups.joined(to)
    return numbered(group, np.ones(len(group), bool))


def _of_the_small(
    joints: Int[np.ndarray, "j 2"], cost: Float64[np.ndarray, " j"], small: Bool[np.ndarray, " c"]
) -> Int[np.ndarray, "l 2"]:
    """The cheapest joint of each small group."""
    rank, best = _cheapest(joints, cost, len(small))
    return joints[np.argsort(rank)][best[small & (best < len(joints))]]


def _mutual(
    joints: Int[np.ndarray, "j 2"], cost: Float64[np.ndarray, " j"], count: int
) -> Int[np.ndarray, "l 2"]:
    """The joints that cost least for both ends."""
    rank, best = _cheapest(joints, cost, count)
    return joints[(best[joints[:, 0]] == rank) & (best[joints[:, 1]] == rank)]


def _cheapest(
    joints: Int[np.ndarray, "j 2"], cost: Float64[np.ndarray, " j"], count: int
) -> tuple[Int[np.ndarray, " j"], Int[np.ndarray, " c"]]:
    """The rank of each joint by cost, and that of each group's cheapest; j for a group without."""
    rank = np.empty(len(joints), np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(joints))
    best = np.full(count, len(joints))
    for column in joints.T:
        np.minimum.at(best, column, rank)
    return rank, best
