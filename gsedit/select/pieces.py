"""Pieces of a body by color, and bodies of several objects that touch, told apart by them.

`n` Gaussians, `m` of them in a body, `s` small groups, `e` pairs of neighbors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

from gsedit.scene.neighbors import linked
from gsedit.select.layers import joints_of, numbered
from gsedit.select.surfaces import Surfaces

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
    group = numbered(
        linked(pairs[_in_one_cell(surfaces, inside, pairs) & (alike > GROUPED)], len(inside)),
        inside,
    )
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
    feet = _feet(surfaces, piece, support, count)
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


def _feet(
    surfaces: Surfaces, piece: Int[np.ndarray, " n"], support: Bool[np.ndarray, " n"], count: int
) -> Float64[np.ndarray, " c"]:
    """Pairs of neighbors between each piece and the support."""
    pairs = surfaces.edges
    both = np.concatenate((pairs, pairs[:, ::-1]))
    on = (piece[both[:, 0]] >= 0) & support[both[:, 1]]
    return np.bincount(piece[both[on, 0]], minlength=count).astype(np.float64)


def _pairs_within(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, "e 2"], Float64[np.ndarray, " e"]]:
    pairs = surfaces.edges
    keep = inside[pairs[:, 0]] & inside[pairs[:, 1]]
    return pairs[keep], surfaces.alike[keep]


def _in_one_cell(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], pairs: Int[np.ndarray, "e 2"]
) -> Bool[np.ndarray, " e"]:
    side = CELL * float(np.sqrt(np.median(surfaces.areas[inside]))) or 1.0
    cells = np.floor(surfaces.points / side).astype(np.int64)
    return (cells[pairs[:, 0]] == cells[pairs[:, 1]]).all(1)


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
    rank = np.empty(len(joints), np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(joints))
    best = np.full(len(small), len(joints))
    for column in joints.T:
        np.minimum.at(best, column, rank)
    return joints[np.argsort(rank)][best[small & (best < len(joints))]]


def _mutual(
    joints: Int[np.ndarray, "j 2"], cost: Float64[np.ndarray, " j"], count: int
) -> Int[np.ndarray, "l 2"]:
    """The joints that cost least for both ends."""
    rank = np.empty(len(joints), np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(joints))
    best = np.full(count, len(joints))
    for column in joints.T:
        np.minimum.at(best, column, rank)
    return joints[(best[joints[:, 0]] == rank) & (best[joints[:, 1]] == rank)]
