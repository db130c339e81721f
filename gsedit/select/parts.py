"""Parts of an object that hold a click, ever smaller: cut at level tops, creases and colors.

What stands on a level top of the object is one part, and the rest another. Elsewhere, water is
poured in at the click and drains evenly everywhere. It flows badly over concave creases, edges of
color and necks, so that a part fills before its neighbors do. The rows that hold most of it are a
part where their border is short, and gets longer both for fewer rows and for more.

`n` Gaussians, `m` sure ones of an object, `e` pairs of neighbors, `g` small groups of Gaussians,
`j` pairs of groups that touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, log, radians

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.sparse import coo_matrix, csr_matrix, diags, identity
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree

from gsedit.scene.neighbors import k_nearest, linked
from gsedit.select.layers import GOES_ON, HULL_MARGIN, SEEN, crossing, flush, level_patches
from gsedit.select.surfaces import Surfaces

LEVELS = 4
"""Most parts one in the other, the whole object being the first."""
LEAST, MOST = 0.03, 0.8
"""Least share of what is seen of the object that is a part, and most of what is seen of the next
larger part: less is a speck, and more is the larger one without a bump of it."""
AMID = 0.5
"""Least share of the foot of what stands on a patch that is off its rim: a thing may have a level
underside, and a chair a back."""
CLEAR = log(1.4)
"""Least rise of the border on both sides, as a logarithm: 0.4 longer. Noise reaches it for
5 of 1,920 clicks on plain and checkered balls, boxes and rods."""
SHORT = 0.6
"""Longest border of a part, of that of a small compact patch, both of the root of the area: where a
plain surface is patchy, borders rise that are as long as any."""
LASTS = 1.1
"""Growth in area over which a rise has to last: single rough spots are no rise."""

PER_GROUP, MOST_GROUPS = 10, 3000
"""Gaussians of a group, whose own colors are noise; and most groups: more take too long."""
ROUNDS, NEAR = 3, 6
"""Rounds in which Gaussians find their group, and the nearest groups each chooses from."""
COLOR = 0.07
"""Difference of two groups' colors (RMS over the channels) at which a third of the water passes."""
TEXTURE = 1.4
"""Such a difference beside it, of the median of groups that touch: texture and noise."""
CREASE = cos(radians(45))
"""Cosine between the normals of two groups, in a concave crease, at which a third passes."""


def parts(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], seeds: Float64[np.ndarray, " n"]
) -> Iterator[Bool[np.ndarray, " n"]]:
    """Yield the object inside, then ever smaller parts of it that hold most of the seeds; at most
    LEVELS in all, each found when it is asked for."""
    yield inside
    whole = _Whole(surfaces, inside, seeds)
    whole = replace(whole, least=LEAST * float(surfaces.seen[whole.sure].sum()))
    count, smaller = 1, _smaller(whole)
    while count < LEVELS and smaller:
        yield (part := smaller.pop(0))
        count += 1
        smaller = smaller or _smaller(replace(whole, inside=part))


@dataclass(frozen=True, eq=False)
class _Whole:
    """An object or a part, to be parted."""

    surfaces: Surfaces
    inside: Bool[np.ndarray, " n"]
    seeds: Float64[np.ndarray, " n"]
    least: float = 0.0
    """Least pixels of a part."""

    @cached_property
    def sure(self) -> Bool[np.ndarray, " n"]:
        """The Gaussians whose looks are known."""
        return self.inside & self.surfaces.solid & (self.surfaces.seen > SEEN)

    @cached_property
    def pairs(self) -> Int[np.ndarray, "e 2"]:
        """Neighbors that are both sure."""
        return self.surfaces.edges[self.sure[self.surfaces.edges].all(1)]


def _smaller(whole: _Whole) -> list[Bool[np.ndarray, " n"]]:
    """The clear parts that hold the seeds, the largest first."""
    sure = whole.sure
    if sure.sum() < 2 * PER_GROUP or not whole.seeds[sure].any():
        return []
    found = _above_or_below(whole) or _filled(whole)
    return [whole.surfaces.spread(each, sure, whole.inside & ~sure) for each in found]


def _above_or_below(whole: _Whole) -> list[Bool[np.ndarray, " n"]]:
    """Return what stands on a level patch, or the rest: the largest that holds the seeds; none
    where nothing stands on one."""
    surfaces, sure, pairs = whole.surfaces, whole.sure, whole.pairs
    weight, seeds = (np.where(sure, each, 0.0) for each in (surfaces.seen, whole.seeds))
    best: list[Bool[np.ndarray, " n"]] = []
    largest = 0.0
    for patch in level_patches(surfaces, whole.inside):
        cut = crossing(surfaces, pairs, patch, patch.above(surfaces.points))
        if not len(cut):
            continue
        number = linked(np.delete(pairs, cut, 0), len(sure))
        large = (seen := np.bincount(number, weight)) >= whole.least
        own = int(np.bincount(number, seeds).argmax())
        ends = number[pairs[cut]]
        border = pairs[cut][large[ends].all(1) & ((ends == own).sum(1) == 1)]
        foot = patch.over(surfaces.points[border].mean(1), -HULL_MARGIN)
        stands = foot.sum() > AMID * len(foot) and flush(surfaces, border).mean() < GOES_ON
        if stands and seen[own] > largest:
            largest = float(seen[own])
            some = sure & large[number]
            best = [surfaces.spread(sure & (number == own), some, sure & ~some)]
    return best


@dataclass(frozen=True, eq=False)
class _Groups:
    """Small groups of Gaussians that are near and face alike."""

    number: Int[np.ndarray, " n"]
    """Group of each Gaussian; -1: none."""
    seen: Float64[np.ndarray, " g"]
    areas: Float64[np.ndarray, " g"]
    joints: Int[np.ndarray, "j 2"]
    borders: Float64[np.ndarray, " j"]
    """Length of the border of two groups, less what creases and colors hold back."""

    @property
    def border(self) -> float:
        """Median length of the border of a group, of the root of its area."""
        around = np.bincount(self.joints.reshape(-1), np.repeat(self.borders, 2), len(self.areas))
        return float(np.median(around / np.sqrt(self.areas)))


def _filled(whole: _Whole) -> list[Bool[np.ndarray, " n"]]:
    """Return what fills together from the seeds, within a clear border, the largest first."""
    groups = _grouped(whole)
    if not len(groups.joints):
        return []
    rank = _filling(groups, whole.seeds)
    order = np.argsort(rank)
    area = np.cumsum(groups.areas[order])
    seen = np.cumsum(groups.seen[order])
    # the borders of fewer groups are noise
    able = (seen >= whole.least) & (seen <= MOST * seen[-1]) & (np.arange(len(seen)) >= 8)
    border = _lengths(groups, rank) / np.sqrt(area)
    able &= border <= SHORT * groups.border
    rises = _rises(border, area, able)
    clear = rises >= max(CLEAR, 0.5 * float(rises.max(initial=0)))
    chosen: list[int] = []
    for i in np.argsort(-rises, kind="stable")[: int(clear.sum())].tolist():
        # less is the same with a rim
        if all(max(area[i], area[j]) > 1.5 * min(area[i], area[j]) for j in chosen):
            chosen.append(i)
    return [whole.sure & (rank[groups.number] <= i) for i in sorted(chosen, reverse=True)]


def _filling(groups: _Groups, seeds: Float64[np.ndarray, " n"]) -> Int[np.ndarray, " g"]:
    """The rank of each group: how early water fills it that is poured in at the seeds, flows over
    the borders and drains with the area, little beside what flows."""
    count, held = len(groups.areas), groups.number >= 0
    flow = _symmetric(groups.joints, groups.borders / groups.borders.mean(), count)
    drained = groups.areas / groups.areas.sum()
    system = diags(np.asarray(flow.sum(1)).reshape(-1) + drained) - flow
    poured = np.bincount(groups.number[held], seeds[held], count)
    rank = np.empty(count, np.int64)
    rank[np.argsort(-spsolve(system.tocsc(), poured), kind="stable")] = np.arange(count)
    return rank


def _lengths(groups: _Groups, rank: Int[np.ndarray, " g"]) -> Float64[np.ndarray, " g"]:
    """Length of the border of the groups up to each rank."""
    first, last = np.sort(rank[groups.joints], 1).T
    count = len(rank)
    change = np.bincount(first, groups.borders, count) - np.bincount(last, groups.borders, count)
    length = np.cumsum(change)
    return np.maximum(length, 1e-4 * length.max())  # parts apart have no border


def _rises(
    border: Float64[np.ndarray, " g"], area: Float64[np.ndarray, " g"], able: Bool[np.ndarray, " g"]
) -> Float64[np.ndarray, " g"]:
    """How much, as a logarithm, the border gets longer both before and after each that is able,
    until one is shorter still; 0 where it does not."""
    length, count = np.log(border), len(border)
    ends = np.searchsorted(area, LASTS * area, "right")  # behind what lasts from each on
    lasting = np.full(count, -np.inf)
    for i in range(int((ends < count).sum())):
        lasting[i : ends[i]] = np.maximum(lasting[i : ends[i]], length[i : ends[i]].min())
    out = np.zeros(count)
    for i in np.flatnonzero(able):
        shorter = np.flatnonzero(length < length[i])
        at = int(np.searchsorted(shorter, i))
        start = shorter[at - 1] if at else 0
        stop = shorter[at] if at < len(shorter) else count
        sides = lasting[start : i + 1].max(), lasting[i:stop].max()
        out[i] = max(min(sides) - length[i], 0.0)
    return out


@dataclass(frozen=True, eq=False)
class _Looks:
    """Places of Gaussians or groups, how they face, and their colors."""

    points: Float64[np.ndarray, "k 3"]
    normals: Float64[np.ndarray, "k 3"]
    colors: Float64[np.ndarray, "k 3"]

    def means(self, seen: Float64[np.ndarray, " k"], number: Int[np.ndarray, " k"]) -> _Looks:
        """The looks of the groups with these numbers, by how much of each is seen."""
        total = np.bincount(number, seen)[:, None]
        points, normals, colors = (
            np.stack([np.bincount(number, seen * each) for each in values.T], 1) / total
            for values in (self.points, self.normals, self.colors)
        )
        return _Looks(points, normals / (np.linalg.norm(normals, axis=1)[:, None] + 1e-12), colors)

    def nearest(self, groups: _Looks, usual: float = np.inf) -> Int[np.ndarray, " k"]:
        """The group that each is most like; `usual` is a square of a difference in color."""
        far, at = k_nearest(groups.points, self.points, min(NEAR, len(groups.points)))
        unlike = np.square(far / np.maximum(far[:, :3].max(1, keepdims=True), 1e-12))
        unlike += np.square(self.normals[:, None] - groups.normals[at]).sum(2)
        unlike += np.square(self.colors[:, None] - groups.colors[at]).mean(2) / usual
        return np.take_along_axis(at, unlike.argmin(1)[:, None], 1)[:, 0]


def _grouped(whole: _Whole) -> _Groups:
    """Groups of the sure Gaussians (k-means): by place and facing, for texture would tear them by
    color; at last each Gaussian goes to the one of its color."""
    surfaces, sure = whole.surfaces, whole.sure
    rows, seen = np.flatnonzero(sure), surfaces.seen[sure]
    pairs = (np.cumsum(sure) - 1)[whole.pairs]
    colors = _surface_colors(surfaces.colors[rows], seen, pairs)
    own = _Looks(surfaces.points[rows], surfaces.normals[rows], colors)
    step = max(PER_GROUP, len(rows) / MOST_GROUPS)
    number = KDTree(own.points).indices[np.arange(step / 2, len(rows), step).astype(np.int64)]
    groups = _Looks(own.points[number], own.normals[number], colors[number])
    for _ in range(ROUNDS):
        number = np.unique(own.nearest(groups), return_inverse=True)[1].reshape(-1)
        groups = own.means(seen, number)
    count = len(groups.points)
    steps = np.linalg.norm(own.points[pairs[:, 0]] - own.points[pairs[:, 1]], axis=1)
    border = _symmetric(number[pairs], steps, count).tocoo()
    once = border.row < border.col
    joints = np.stack((border.row, border.col), 1)[once].astype(np.int64)
    apart = np.square(np.subtract(*groups.colors[joints.T])).mean(1)
    usual = COLOR**2 + TEXTURE**2 * float(np.median(apart)) if len(joints) else np.inf
    borders = border.data[once] * _passes(groups, joints) * np.exp(-apart / usual)
    sharp = np.full(len(sure), -1)
    sharp[rows] = own.nearest(groups, usual)
    areas = np.bincount(number, surfaces.areas[rows], count)
    areas = np.maximum(areas, 1e-3 * areas.mean())  # single ones have none
    return _Groups(sharp, np.bincount(number, seen, count), areas, joints, borders)


def _passes(groups: _Looks, joints: Int[np.ndarray, "j 2"]) -> Float64[np.ndarray, " j"]:
    """Share of the water that a crease between two groups lets pass, in [0, 1]."""
    facing, at = groups.normals[joints.T], groups.points[joints.T]
    bend = (1 - (facing[0] * facing[1]).sum(1).clip(-1, 1)) / (1 - CREASE)
    concave = ((facing[0] - facing[1]) * (at[0] - at[1])).sum(1) < 0
    return np.exp(-np.where(concave, 1.0, 0.1) * bend)  # a box is one part


def _surface_colors(
    colors: Float64[np.ndarray, "m 3"],
    seen: Float64[np.ndarray, " m"],
    pairs: Int[np.ndarray, "e 2"],
) -> Float64[np.ndarray, "m 3"]:
    """Colors of the surface: means over neighbors, by how much of each is seen."""
    around = _symmetric(pairs, np.ones(len(pairs)), len(seen)) + identity(len(seen))
    total, weight = colors * seen[:, None], seen
    for _ in range(2):  # of Gaussians, it becomes that of the surface
        total, weight = around @ total, around @ weight
    return total / weight[:, None]


def _symmetric(
    pairs: Int[np.ndarray, "e 2"], values: Float64[np.ndarray, " e"], count: int
) -> csr_matrix:
    upper = coo_matrix((values, tuple(pairs.T)), (count, count)).tocsr()
    return (upper + upper.T).tocsr()
