"""Selections by neighbors: clusters, and selections that are grown or shrunk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.neighbors import k_nearest, linked
from gsedit.scene.shapes import Bool, Float32, Float64, Int
from gsedit.scene.table import SplatTable
from gsedit.select.rules import EVERYTHING, Flags, Selection, check_finite, check_positive

TYPICAL = 8.0
"""A gap, in median distances of a Gaussian to its nearest one, where none is given."""
SAMPLED_GAUSSIANS = 20_000
"""Gaussians of which that median is taken."""
_OFFSETS = [d for d in product(range(-2, 3), repeat=3) if d > (0, 0, 0) and min(map(abs, d)) < 2]
SHELLS = [[d for d in _OFFSETS if sum(map(abs, d)) == distance] for distance in range(1, 6)]
"""Half of the cells within two sides, by their distance, without the corners: those are farther
than `gap`."""


def cluster(n: int = 1, gap: float | None = None, of: Selection = EVERYTHING) -> Selection:
    """The n largest clusters: of centers linked by gaps of at most `gap`, among `of`."""
    if n < 1:
        raise UsageError(f"cluster: {n} clusters: give 1 or more")
    return _clusters(
        lambda points, labels: np.argsort(-np.bincount(labels), kind="stable")[:n], gap, of
    )


def cluster_at(
    x: float, y: float, z: float, gap: float | None = None, of: Selection = EVERYTHING
) -> Selection:
    """The cluster of the center nearest to x,y,z."""
    check_finite("cluster", x, y, z)
    return _clusters(
        lambda points, labels: labels[[np.linalg.norm(points - (x, y, z), axis=1).argmin()]],
        gap, of,
    )  # fmt: skip


def _clusters(
    choose: Callable[[np.ndarray, np.ndarray], np.ndarray], gap: float | None, of: Selection
) -> Selection:
    """The clusters among what `of` selects whose numbers are chosen, from points and labels."""
    if gap is not None:
        check_positive("cluster", "gap", gap)

    def change(among: Flags, table: SplatTable) -> Flags:
        rows = np.flatnonzero(among & np.isfinite(table.means).all(1))
        inside = np.zeros(len(table), bool)
        if len(rows):
            points = table.means[rows].astype(np.float64)
            labels = cluster_labels(points, typical_gap(points) if gap is None else gap)
            inside[rows[np.isin(labels, choose(points, labels))]] = True
        return inside

    return _of_whole(of, change)


def _of_whole(inner: Selection, change: Callable[[Flags, SplatTable], Flags]) -> Selection:
    """A selection of the mask of another, that needs all rows at once."""
    return replace(inner, mask=lambda table: change(inner.mask(table), table), whole=True)


def typical_gap(points: Float64[np.ndarray, "n 3"]) -> float:
    """`TYPICAL` median distances to the nearest other place."""
    places = np.unique(points, axis=0)
    if len(places) < 2:
        return 1.0
    asked = places[:: -(-len(places) // SAMPLED_GAUSSIANS)]
    distance, _ = k_nearest(places, asked, 2)
    return TYPICAL * float(np.median(distance[:, 1]))


def cluster_labels(points: Float64[np.ndarray, "n 3"], gap: float) -> Int[np.ndarray, " n"]:
    """The number of each point's cluster, from 0."""
    keys, weights = _cells(points, gap / np.sqrt(3) * (1 - 1e-9))
    order = np.argsort(keys, kind="stable")
    cells, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    sample = points[order[first]]
    labels, untested = np.arange(len(cells)), [np.zeros((0, 2), np.int64)]
    for offsets in SHELLS:
        found = [_neighbors(cells, int(np.array(offset) @ weights)) for offset in offsets]
        pairs = np.concatenate(found)
        pairs = pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]
        near = np.linalg.norm(sample[pairs[:, 0]] - sample[pairs[:, 1]], axis=1) <= gap
        labels = _joined(labels, pairs[near])
        # two centers of the cells may be nearer than those that were compared
        untested.append(pairs[~near & (counts[pairs].max(1) > 1)])
    rest = np.concatenate(untested)
    rest = rest[labels[rest[:, 0]] != labels[rest[:, 1]]]
    labels = _joined(labels, rest[_touch(points[order], first, counts, rest, gap)])
    result = np.empty(len(points), np.int64)
    result[order] = np.repeat(labels, counts)
    return result


def _cells(
    points: Float64[np.ndarray, "n 3"], side: float
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, "3"]]:
    """A number for the cell of each point, and what one cell along each axis adds to it.

    Empty layers are left out: three or more between two occupied ones become three, so that a wide
    scene has small numbers. Beyond 64 bits the numbers wrap round, and two cells share one by a
    chance of less than one in a million.
    """
    layers = np.empty(points.shape, np.int64)
    for axis in range(3):
        position = np.floor(points[:, axis] / side)
        occupied, index = np.unique(position, return_inverse=True)
        steps = np.minimum(np.diff(occupied), 3.0).astype(np.int64)
        layers[:, axis] = np.concatenate([[0], np.cumsum(steps)])[index.reshape(-1)] + 2
    extents = layers.max(0) + 3
    with np.errstate(over="ignore"):
        weights = np.array([extents[1] * extents[2], extents[2], 1], np.int64)
        return layers @ weights, weights


def _neighbors(cells: Int[np.ndarray, " c"], step: int) -> Int[np.ndarray, "p 2"]:
    """Pairs of occupied cells whose numbers, sorted, are `step` apart."""
    wanted = cells + np.int64(step)
    at = np.minimum(np.searchsorted(cells, wanted), len(cells) - 1)
    hit = np.flatnonzero(cells[at] == wanted)
    return np.stack([hit, at[hit]], 1)


def _touch(
    points: Float64[np.ndarray, "n 3"],
    first: np.ndarray,
    counts: np.ndarray,
    pairs: np.ndarray,
    gap: float,
) -> Bool[np.ndarray, " p"]:
    """Whether two points of a pair of cells are at most `gap` apart; points in order of cells.

    All pairs in one k-d tree: each has a place of its own along a fourth axis.
    """
    if not len(pairs):
        return np.zeros(0, bool)
    origin = points[first[pairs[:, 0]]]

    def placed(side: int) -> tuple[np.ndarray, np.ndarray]:
        many = counts[pairs[:, side]]
        pair = np.repeat(np.arange(len(pairs)), many)
        start = np.cumsum(many) - many
        row = np.arange(len(pair)) - start[pair] + first[pairs[pair, side]]
        apart = (points[row] - origin[pair]) / gap
        return np.column_stack([apart, 16.0 * pair]), pair

    tree, _ = placed(1)
    asked, pair = placed(0)
    distance, _ = k_nearest(tree, asked, 1, bound=1 + 1e-12)
    return np.bincount(pair[np.isfinite(distance[:, 0])], minlength=len(pairs)) > 0


def _joined(labels: Int[np.ndarray, " c"], pairs: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, " c"]:
    """Labels from 0 of which those of a pair's two cells are one."""
    return linked(labels[pairs], int(labels.max()) + 1)[labels]


def grow(selection: Selection, radius: float) -> Selection:
    """A selection, and what is at most `radius` from it."""
    check_positive("grow", "radius", radius)
    return _of_whole(selection, lambda inside, table: inside | _within(table.means, inside, radius))


def shrink(selection: Selection, radius: float) -> Selection:
    """A selection, without what is at most `radius` from the rest."""
    check_positive("shrink", "radius", radius)
    return _of_whole(
        selection, lambda inside, table: inside & ~_within(table.means, ~inside, radius)
    )


def _within(
    means: Float32[np.ndarray, "n 3"], sources: Bool[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Whether a row is no source, and at most `radius` from one."""
    usable = np.isfinite(means).all(1)
    found = np.zeros(len(means), bool)
    given, asked = usable & sources, np.flatnonzero(usable & ~sources)
    if not given.any() or not len(asked):
        return found
    points = means[asked]
    # far points are cheap to leave out, and most are far
    low, high = means[given].min(0) - radius, means[given].max(0) + radius
    near = ((points >= low) & (points <= high)).all(1)
    # query asks for distances below its bound: the next number includes the bound itself
    distance, _ = k_nearest(means[given], points[near], 1, bound=np.nextafter(radius, np.inf))
    found[asked[near]] = np.isfinite(distance[:, 0])
    return found
