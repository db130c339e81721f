"""How near the neighbors of Gaussians are, how well others cover a point, how far points extend.

`n` Gaussians, `m` points. Time and memory depend on how many Gaussians there are, not on how far
apart: a scene 10^6 wide costs what a small one does.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int64

from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SplatTable

NEIGHBORS = 8
"""Fewer make the distance noisy; more reach across gaps between surfaces."""
AT_ONCE = 1 << 17
"""Points of one query: 17 MB of distances and indices."""


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


def extent_of(points: Float[np.ndarray, "n 3"]) -> float:
    """The diagonal of the box that holds all but the outermost 2 % of the points."""
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))
