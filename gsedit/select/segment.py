"""A scene as objects on a ground, before walls and a background: segments, told without words.

`n` Gaussians, `m` of them in a body, `c` small groups, `e` pairs of neighbors; world units.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int
from torch import Tensor

from gsedit.scene.framing import weighted_quantile
from gsedit.scene.neighbors import extent_of, k_nearest, linked
from gsedit.select.layers import find_stacks, flush, joints_of, numbered
from gsedit.select.surfaces import Surfaces, look
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

Kind = Literal["object", "ground", "wall", "background", "sky"]

LEAST_SEEN, LEAST_ALONE = 0.002, 0.02
"""Least share of what is seen near the place that is an object; and where no ground is, on which
it could stand."""
LEAST_ROWS = 16
"""Least Gaussians of an object."""
RIM, RIM_SEEN = 0.5, 10.0
"""Share of the Gaussians of a rim that are next to the ground or a wall, and most that is seen of
one, against the least of an object."""
TAIL = 0.02
"""Share of the seen pixels of a segment that may lie beyond each side of its box."""
CELLS, MOST_COLORS = 6, 24
"""Cells of a channel, and most colors, of a palette."""
FEET, FEET_TOUCH = 0.05, 0.1
"""Share of an object's Gaussians that are its lowest, and of these that touch what it stands on."""
TOUCHING = 0.15
"""Largest distance of a touch, of the object's extent, beside two distances between neighbors: what
no camera sees under an object has no Gaussians."""
LOOSE = 0.25
"""Largest gap of what hovers beside a larger object and is a part of it, of that one's extent."""
JOINED, ACROSS, SLIGHT = 0.02, 24, 0.5
"""Largest gap between a leg and what it carries, of the extent of that; cells along that, and most
that legs under it cover, of those that it covers."""
SKY_ELEVATION, SKY_DISTANCE = 8.0, 2.5
"""Degrees above the horizon, and distances of the cameras, from which the background may be sky."""
SKY_LIGHT, SKY_WARMTH = 0.4, 0.04
"""Least mean of the channels of the sky, and most that green or red is above its blue."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One segment: where it is and how it looks."""

    number: int
    kind: Kind
    pixels: float
    """Share of all pixels of the looked-at views that it fills, in [0, 1]."""
    low: tuple[float, float, float]
    """Lowest corner of the box that holds nearly all of it: right, back and up as the cameras see
    the place, world units from its middle."""
    high: tuple[float, float, float]
    color: tuple[float, float, float]
    """Median sRGB in [0, 1]."""
    palette: tuple[tuple[tuple[float, float, float], float], ...]
    """Colors (sRGB in [0, 1]) with their shares of what is seen of it, the largest first."""
    stands_on: int
    """Number of the segment under it; -1: none."""

    @property
    def size(self) -> float:
        """Diagonal of the box, world units."""
        return float(np.linalg.norm(np.subtract(self.high, self.low)))

    @property
    def middle(self) -> tuple[float, float, float]:
        """Middle of the box: right, back, up."""
        x, y, z = np.add(self.low, self.high).tolist()
        return x / 2, y / 2, z / 2


@dataclass(frozen=True, eq=False)
class Segments:
    """The segments of a scene."""

    labels: Int[Tensor, " n"]
    """Number of the segment each Gaussian is in."""
    rows: tuple[Segment, ...]
    """The segments by number: objects from the largest to the smallest, then the rest."""
    view: int
    """Index of the camera as which right, left, front and back are told; 0 where none was given."""

    @property
    def objects(self) -> tuple[Segment, ...]:
        """Segments that are objects, the largest first."""
        return tuple(each for each in self.rows if each.kind == "object")

    @property
    def carried(self) -> Counter[int]:
        """How many objects stand on each object that one stands on, by its number."""
        objects = self.objects  # they are the first rows
        return Counter(r.stands_on for r in objects if 0 <= r.stands_on < len(objects))

    def inside(self, *numbers: int) -> Bool[Tensor, " n"]:
        """Flag the Gaussians of the segments with these numbers."""
        return torch.isin(self.labels, torch.tensor(numbers, dtype=self.labels.dtype))


@torch.no_grad()
def segment(scene: Gaussians, cameras: Sequence[Camera] = ()) -> Segments:
    """Tell the objects of a scene from each other, its ground, walls, background and sky.

    A scene of more than 200,000 Gaussians is told apart by groups of them. Without cameras, some
    are found. Raises UsageError for an empty scene.
    """
    surfaces = look(scene.detach(), cameras)
    found = segment_surfaces(surfaces)
    return replace(found, labels=surfaces.expanded(found.labels))


def segment_surfaces(surfaces: Surfaces) -> Segments:
    """The segments of a scene whose surfaces are known."""
    away = np.linalg.norm(surfaces.points - surfaces.place.center.numpy(), axis=1)
    near = np.full(len(surfaces), True) if surfaces.place.alone else away < surfaces.place.radius
    kinds, labels = _kinds(surfaces, near, away)
    known = (labels >= 0) & surfaces.solid
    if not known.any():
        kinds.append("object")
        labels = np.full(len(labels), len(kinds) - 1)
    labels = surfaces.spread(labels, known, labels < 0)
    return _ordered(surfaces, _with_hovering(surfaces, labels, kinds), kinds)


def _kinds(
    surfaces: Surfaces, near: Bool[np.ndarray, " n"], away: Float64[np.ndarray, " n"]
) -> tuple[list[Kind], Int[np.ndarray, " n"]]:
    """The kind of each segment, and labels of what is surely of one; -1 elsewhere."""
    bodies, ground, walls = find_stacks(surfaces, near)
    labels = np.full(len(surfaces), -1)
    kinds: list[Kind] = []

    def add(inside: Bool[np.ndarray, " n"], kind: Kind) -> None:
        if inside.any():
            labels[inside] = len(kinds)
            kinds.append(kind)

    sky = _sky(surfaces, near, away)
    far = ~near & ~sky
    least = (LEAST_SEEN if ground.any() else LEAST_ALONE) * surfaces.seen[near].sum()
    for number in range(int(bodies.max()) + 1):
        body = bodies == number
        if surfaces.seen[body].sum() < least or body.sum() < LEAST_ROWS:
            continue
        # far from the middle it is background
        if np.median(away[body]) > 0.8 * surfaces.place.radius and not surfaces.place.alone:
            far |= body
            continue
        support = ~body & (ground | (bodies >= 0))
        beside = ground | (walls >= 0)
        for thing in split_touching(surfaces, body, support):
            if _is_thing(surfaces, thing, beside, least):
                add(thing, "object")
    add(ground, "ground")
    for number in range(int(walls.max()) + 1):
        add(walls == number, "wall")
    add(far, "background")
    add(sky, "sky")
    return kinds, labels


def _is_thing(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], beside: Bool[np.ndarray, " n"], least: float
) -> bool:
    """Whether enough is seen of it, and it is no rim of the ground or of a wall `beside` it."""
    seen = surfaces.seen[inside].sum()
    if seen < least or inside.sum() < LEAST_ROWS:
        return False
    if seen > RIM_SEEN * least:
        return True
    return bool((surfaces.touches(inside, beside) > 0).sum() < RIM * inside.sum())


def _sky(
    surfaces: Surfaces, near: Bool[np.ndarray, " n"], away: Float64[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians that are far and high, light, and not warmer than grey."""
    offset = surfaces.points - surfaces.place.center.numpy()
    elevation = np.degrees(np.arcsin((offset @ surfaces.up / np.maximum(away, 1e-12)).clip(-1, 1)))
    red, green, blue = surfaces.colors.T
    cool = (blue > red - SKY_WARMTH) & (blue > green - SKY_WARMTH)
    light = surfaces.colors.mean(1) > SKY_LIGHT
    high = (elevation > SKY_ELEVATION) & (away > SKY_DISTANCE * surfaces.place.distance)
    return ~near & cool & light & high


def _ordered(surfaces: Surfaces, labels: Int[np.ndarray, " n"], kinds: list[Kind]) -> Segments:
    """The segments, objects first, by the size of their boxes."""
    held = np.unique(labels)
    labels, kinds = np.searchsorted(held, labels), [kinds[i] for i in held]
    rows = [_row(surfaces, labels, i, kind) for i, kind in enumerate(kinds)]
    order = sorted(range(len(rows)), key=lambda i: (kinds[i] != "object", -rows[i].size))
    new = np.empty(len(rows), np.int64)
    new[order] = np.arange(len(rows))
    under = _standing(surfaces, labels, kinds)
    told = []
    for number, old in enumerate(order):
        each = rows[old]
        on = int(new[under[old]]) if under[old] >= 0 else -1
        told.append(replace(each, number=number, stands_on=on))
    return Segments(torch.from_numpy(new[labels]), tuple(told), surfaces.view)


def _row(surfaces: Surfaces, labels: Int[np.ndarray, " n"], number: int, kind: Kind) -> Segment:
    rows = np.flatnonzero(labels == number)
    weight = surfaces.seen[rows] + 1e-9
    place = surfaces.place
    right = torch.linalg.cross(place.up, place.front)
    axes = torch.stack((right, -place.front, place.up)).numpy()
    local = (surfaces.points[rows] - place.center.numpy()) @ axes.T
    low, high = (_quantile(local, weight, share) for share in (TAIL, 1 - TAIL))
    color = _quantile(surfaces.colors[rows], weight, 0.5)
    share = float(weight.sum() / max(surfaces.seen.sum(), 1e-9))
    palette = _palette(surfaces.colors[rows], weight)
    return Segment(number, kind, share, low, high, color, palette, -1)


def _palette(
    colors: Float64[np.ndarray, "m 3"], weights: Float64[np.ndarray, " m"]
) -> tuple[tuple[tuple[float, float, float], float], ...]:
    """The means of the most frequent cells of color, with their shares."""
    cell = (colors * (CELLS - 1e-6)).astype(np.int64) @ np.array([CELLS**2, CELLS, 1])
    total = np.bincount(cell, weights=weights, minlength=CELLS**3)
    sums = [np.bincount(cell, weights=weights * c, minlength=CELLS**3) for c in colors.T]
    largest = np.argsort(-total, kind="stable")[:MOST_COLORS]
    largest = largest[total[largest] > 0]
    means = np.stack(sums, 1)[largest] / total[largest, None]
    shares = total[largest] / total.sum()
    return tuple(((r, g, b), share) for (r, g, b), share in zip(means.tolist(), shares.tolist()))


def _quantile(
    values: Float64[np.ndarray, "m 3"], weights: Float64[np.ndarray, " m"], share: float
) -> tuple[float, float, float]:
    """The least value of each column up to which a share of the weight lies."""
    found = weighted_quantile(torch.from_numpy(values), torch.from_numpy(weights), share)
    x, y, z = found.tolist()
    return x, y, z


def _standing(
    surfaces: Surfaces, labels: Int[np.ndarray, " n"], kinds: list[Kind]
) -> Int[np.ndarray, " s"]:
    """The segment under the lowest Gaussians of each object, that it touches; -1: none."""
    rows = [np.flatnonzero((labels == i) & surfaces.solid) for i in range(len(kinds))]
    bottom = [np.quantile(surfaces.heights[each], FEET) if len(each) else np.inf for each in rows]
    under = np.full(len(kinds), -1)
    for number in (i for i, kind in enumerate(kinds) if kind == "object"):
        carrying = [
            kind == "ground" or (kind == "object" and bottom[i] < bottom[number])
            for i, kind in enumerate(kinds)
        ]
        if not len(own := rows[number]):
            continue
        feet = own[surfaces.heights[own] <= bottom[number]]
        reach = TOUCHING * extent_of(surfaces.points[own])
        reach += 2 * float(np.sqrt(np.median(surfaces.areas[own])))
        low = surfaces.heights <= np.quantile(surfaces.heights[feet], 0.5) + reach
        others = np.flatnonzero(surfaces.solid & np.array(carrying)[labels] & low)
        if not len(others):
            continue
        far, at = k_nearest(surfaces.points[others], surfaces.points[feet], 1, reach)
        if np.isfinite(far).mean() >= FEET_TOUCH:
            under[number] = np.bincount(labels[others[at[np.isfinite(far)]]]).argmax()
    return under


def _with_hovering(
    surfaces: Surfaces, labels: Int[np.ndarray, " n"], kinds: list[Kind]
) -> Int[np.ndarray, " n"]:
    """The labels with parts that hover beside a larger object, as a hand, or stand under one that
    other parts carry, too, as a leg, made part of it."""
    under = _standing(surfaces, labels, kinds)
    things, points = [i for i, kind in enumerate(kinds) if kind == "object"], surfaces.points
    rows = {i: np.flatnonzero((labels == i) & surfaces.solid) for i in things}
    size = {i: extent_of(points[rows[i]]) if len(rows[i]) else 0.0 for i in things}
    for small in sorted(things, key=lambda i: size[i]):
        gaps = {
            large: _gap(surfaces, rows[small], rows[large], leg=bool(under[small] >= 0))
            / size[large]
            for large in things
            if size[large] > size[small] > 0
            and (
                under[large] != small
                if under[small] < 0
                else _is_leg(surfaces, rows[small], rows[large])
            )
        }
        if gaps and min(gaps.values()) < (LOOSE if under[small] < 0 else JOINED):
            labels = np.where(labels == small, min(gaps, key=lambda i: gaps[i]), labels)
    return labels


def _gap(
    surfaces: Surfaces, small: Int[np.ndarray, " m"], large: Int[np.ndarray, " k"], *, leg: bool
) -> float:
    """Distance between two things. That of a leg is measured from its upper half to what is higher
    than its middle, less two distances between its neighbors: its foot is far from the top."""
    middle = np.median(surfaces.heights[small]) if leg else -np.inf
    small, large = (each[surfaces.heights[each] >= middle] for each in (small, large))
    if not len(large):
        return np.inf
    far = k_nearest(surfaces.points[large], surfaces.points[small], 1)[0].min()
    return float(far - 2 * leg * np.sqrt(np.median(surfaces.areas[small])))


def _is_leg(surfaces: Surfaces, small: Int[np.ndarray, " m"], large: Int[np.ndarray, " k"]) -> bool:
    """Whether something stands wholly under something else, which goes down as far beside it or is
    much wider: legs and beams under a top, and no plinth under a statue."""
    front = surfaces.place.front.numpy()
    axes = np.stack((front, np.cross(surfaces.up, front), surfaces.up), 1)
    leg, top = (surfaces.points[rows] @ axes for rows in (small, large))
    (low, high), (least, most) = (np.quantile(each, (TAIL, 1 - TAIL), 0) for each in (leg, top))
    if not ((high < most).all() and (low > least)[:2].all()):
        return False
    step = extent_of(surfaces.points[large]) / ACROSS
    narrow, wide = (len(np.unique(each[:, :2] // step, axis=0)) for each in (leg, top))
    return bool(least[2] < (low + high)[2] / 2 or narrow < SLIGHT * wide)


# ---- pieces by color, by which things of one body are told apart that touch ----------------------

CELL = 4.0
"""Side of the cells in which Gaussians are grouped first, in distances between neighbors."""
SAME_COLOR = 0.16
"""Largest difference of the mean colors (RMS over the channels) of pieces that are joined."""
ROUNDS = 60
"""Most rounds of joining; each joins all pairs that are each other's nearest."""
NECK = 2.5
"""Most pairs of neighbors between two things that only touch, in square roots of the smaller's
Gaussians: a patch of color that lies in another has more around it."""
SMOOTH = 0.45
"""Share of smooth joints from which two pieces are one surface, as a top half in the shade."""
LEAST_FOOT = 3
"""Least pairs of neighbors between a piece and what it stands on."""


def pieces(surfaces: Surfaces, inside: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The number, from 0, of the piece of about one color each Gaussian inside is in; -1: none."""
    pairs, alike = _pairs_within(surfaces, inside)
    if not inside.any():
        return np.full(len(inside), -1)
    side = CELL * float(np.sqrt(np.median(surfaces.areas[inside]))) or 1.0
    cells = np.floor(surfaces.points / side).astype(np.int64)
    together = (cells[pairs[:, 0]] == cells[pairs[:, 1]]).all(1) & (alike > 0.3)
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
    smooth = flush(surfaces, pairs)
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
        narrow[joints_of(group[piece[pairs]], count, 1 * smooth)[1] >= SMOOTH * times] += 1000
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
        joints = groups.joints[able]
        rank, best = _cheapest(joints, cost[able], len(groups.sizes))
        links = joints[(best[joints] == rank[:, None]).all(1)]  # that cost least for both ends
        if not len(links):
            break
        to = linked(links, len(groups.sizes))
        group, groups = to[group], groups.joined(to)
    for _ in range(ROUNDS):  # the small ones with what is most like them, or most around them
        small = groups.sizes < 0.03 * len(group)
        cost = (groups.apart + SAME_COLOR) / groups.times
        rank, best = _cheapest(groups.joints, cost, len(small))
        links = groups.joints[np.argsort(rank)][best[small & (best < len(rank))]]
        if not len(links):
            break
        to = linked(links, len(groups.sizes))
        group, groups = to[group], groups.joined(to)
    return numbered(group, np.ones(len(group), bool))


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
