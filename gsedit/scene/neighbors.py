"""Neighbors: how near they are, which points cover another, clusters, how far points extend, and an
order in which they are near each other.

`n` Gaussians, `m` points. Time and memory depend on how many Gaussians there are, not on how far
apart: a scene 10^6 wide costs what a small one does.
"""

from __future__ import annotations

import numpy as np

from gsedit.scene.quaternions import rotations
from gsedit.scene.shapes import Bool, Float, Float32, Float64, Int, Int64, UInt64
from gsedit.scene.table import SplatTable

NEIGHBORS = 8
"""Fewer make the distance noisy; more reach across gaps between surfaces."""
AT_ONCE = 1 << 17
"""Points of one query: 17 MB of distances and indices."""
TYPICAL = 8.0
"""A gap between clusters, in median distances of a Gaussian to its nearest one."""
MIXED = np.array((0x1E3779B97F4A7C15, 0x42B2AE3D27D4EB4F, 0x165667B19E3779F9), np.int64)
"""Large odd factors that make one number of a cell's three; it wraps round, and two cells share one
by a chance of less than one in a million."""


def nearest(
    means: Float[np.ndarray, "n 3"], k: int = NEIGHBORS
) -> tuple[Float64[np.ndarray, " n"], Int64[np.ndarray, "n k"]]:
    """The distance to the k-th neighbor, and the rows of the k nearest, or of all if fewer.

    Gaussians at the very same place count as one: they would hide how far the others are.
    """
    _, first, same = np.unique(means, axis=0, return_index=True, return_inverse=True)
    same = same.reshape(-1)  # numpy 2.0 gives it another shape
    places = means[first].astype(np.float64)
    k = min(k, len(places) - 1)
    if k < 1:
        return np.zeros(len(means)), np.zeros((len(means), 0), np.int64)
    distance, at = k_nearest(places, places, k + 1)
    return distance[same, -1], first[at[:, 1:]][same]


def covers(
    table: SplatTable, points: Float[np.ndarray, "m 3"]
) -> tuple[Int64[np.ndarray, " p"], Int64[np.ndarray, " p"], Float64[np.ndarray, " p"]]:
    """The Gaussians that are over each point, of similar ones the nearest few: points and rows of
    `p` pairs, and the opacity of the Gaussian there.

    A disc counts as a ball of its middle radius: it covers a point that is just off its surface.
    Gaussians are searched in classes of similar size: a wide one covers points far from its center.
    """
    ordered = np.sort(table.scales, 1)
    thick, reach = np.maximum(table.scales, ordered[:, 1:2]), ordered[:, 2]
    size = np.floor(np.log2(np.maximum(reach, np.finfo(np.float32).tiny))).astype(np.int64)
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for each in np.unique(size).tolist():
        rows = np.flatnonzero(size == each)
        k, bound = min(NEIGHBORS + 1, len(rows)), 3 * 2.0 ** (each + 1)  # it ends at 3 sigma
        distance, at = k_nearest(table.means[rows], points, k, bound)
        near = np.isfinite(distance)
        point, row = np.nonzero(near)[0], rows[at[near]]
        offset = points[point] - table.means[row]
        local = np.einsum("mi,mij->mj", offset, rotations(table.quats[row])) / thick[row]
        alpha = table.opacities[row] * np.exp(-0.5 * np.square(local).sum(1))
        found.append((point, row, alpha))
    point, row, alpha = (np.concatenate(column) for column in zip(*found))
    return point, row, alpha


def k_nearest(
    among: Float[np.ndarray, "n d"], points: Float[np.ndarray, "m d"], k: int, bound: float = np.inf
) -> tuple[Float64[np.ndarray, "m k"], Int64[np.ndarray, "m k"]]:
    """Distances and rows in `among` of the `k` points nearest to each of `points`, nearest first.

    A neighbor at `bound` or beyond is left out: its distance is infinite and its row is n.
    """
    from scipy.spatial import KDTree

    tree = KDTree(among)
    distance, rows = np.empty((len(points), k)), np.empty((len(points), k), np.int64)
    order = tree.indices if points is among else np.arange(len(points))  # near ones in a row: -30 %
    for start in range(0, len(points), AT_ONCE):
        part = order[start : start + AT_ONCE]
        found = tree.query(points[part], k=k, distance_upper_bound=bound, workers=-1)
        distance[part], rows[part] = (np.asarray(each).reshape(-1, k) for each in found)
    return distance, rows


def linked(pairs: Int64[np.ndarray, "p 2"], count: int) -> Int64[np.ndarray, " n"]:
    """The number, from 0, of the group that pairs link each of `count` things to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs), bool), tuple(pairs.T)), (count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def typical_gap(points: Float64[np.ndarray, "n 3"]) -> float:
    """`TYPICAL` median distances to the nearest other place."""
    places = np.unique(points, axis=0)
    if len(places) < 2:
        return 1.0
    asked = places[:: -(-len(places) // 20_000)]
    distance, _ = k_nearest(places, asked, 2)
    return TYPICAL * float(np.median(distance[:, 1]))


def cluster_labels(points: Float64[np.ndarray, "n 3"], gap: float) -> Int[np.ndarray, " n"]:
    """The number of each point's cluster, from 0.

    Points are sorted into cells whose points all are at most `gap` apart; then cells are linked.
    """
    from scipy.spatial import KDTree

    side = gap / np.sqrt(3) * (1 - 1e-9)
    cells = np.floor(points / side)
    bits = (cells + 0.0).view(np.int64)  # of any size; -0 is 0
    keys = (bits ^ (bits >> 29)) @ MIXED
    order = np.argsort(keys, kind="stable")
    _, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    middles, sample = side * (cells[order[first]] + 0.5), points[order[first]]
    pairs = KDTree(middles).query_pairs(2 * gap, output_type="ndarray")
    near = np.linalg.norm(sample[pairs[:, 0]] - sample[pairs[:, 1]], axis=1) <= gap
    labels = linked(pairs[near], len(first))
    # two centers of the cells may be nearer than those that were compared
    rest = pairs[(labels[pairs[:, 0]] != labels[pairs[:, 1]]) & (counts[pairs].max(1) > 1)]
    rest = rest[_touch(points[order], first, counts, rest, gap)]
    labels = linked(labels[rest], int(labels.max()) + 1)[labels]
    result = np.empty(len(points), np.int64)
    result[order] = np.repeat(labels, counts)
    return result


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


def beside(
    means: Float32[np.ndarray, "n 3"], sources: Bool[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Flag the rows that are no source, and at most `radius` from one."""
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


def extent_of(points: Float[np.ndarray, "n 3"]) -> float:
    """The diagonal of the box that holds all but the outermost 2 % of the points."""
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))


def morton_order(means: Float32[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """The rows along the Z curve of their bounding box; equal places keep their order.

    Rows that are not finite come last.
    """
    return np.argsort(morton_codes(means), kind="stable")


def morton_codes(means: Float32[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """The place of each row on the Z curve of the finite rows' bounding box."""
    finite = np.asarray(np.isfinite(means).all(1))
    if not finite.any():
        return np.zeros(len(means), np.uint64)
    inside = means if finite.all() else means[finite]
    low = inside.min(0).astype(np.float64)
    size = np.maximum(inside.max(0) - low, np.finfo(np.float32).tiny)
    with np.errstate(invalid="ignore", over="ignore"):
        cells = (means - low) / size * ((1 << 21) - 1)  # 63 bits of 64
    codes = interleave(np.where(finite[:, None], cells, 0))
    codes[~finite] = np.uint64(0xFFFFFFFFFFFFFFFF)
    return codes


def interleave(cells: np.ndarray) -> UInt64[np.ndarray, " n"]:
    """Morton codes of integer cells (n 3, from 0 to 2^21 - 1); x has the lowest bit."""
    codes = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        codes |= _spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis)
    return codes


def _spread(cells: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Numbers with two zero bits after each of their lowest 21 bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    return cells
