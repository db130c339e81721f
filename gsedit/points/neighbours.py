"""How near the neighbours of Gaussians are, and how well others cover a point: by k-d trees.

`n` Gaussians, `m` points. Time and memory depend on how many Gaussians there are, not on how far
apart: a scene 10^6 wide costs what a small one does.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64

from gsedit.files.table import SplatTable

NEIGHBOURS = 8
"""Fewer make the distance noisy; more reach across gaps between surfaces."""
AT_ONCE = 1 << 17
"""Points of one query: 17 MB of distances and indices."""
REACH = 3.0
"""Standard deviations at which a Gaussian ends: 1 % of its opacity is left there."""


def rotations(quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    """Matrices whose columns are the axes; quaternions wxyz of any length above 0."""
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], 1)


def nearest(
    means: Float[np.ndarray, "n 3"], k: int = NEIGHBOURS
) -> tuple[Float64[np.ndarray, " n"], Int64[np.ndarray, "n k"]]:
    """The distance to the k-th neighbour, and the rows of the k nearest, or of all if fewer.

    Gaussians at the very same place count as one: they would hide how far the others are.
    """
    from scipy.spatial import cKDTree

    first, same = _places(means)
    places = means[first].astype(np.float64)
    k = min(k, len(places) - 1)
    if k < 1:
        return np.zeros(len(means)), np.zeros((len(means), 0), np.int64)
    tree = cKDTree(places)
    distance, rows = np.empty(len(places)), np.empty((len(places), k), np.int64)
    for start in range(0, len(places), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        found, at = tree.query(places[part], k=k + 1, workers=-1)
        distance[part], rows[part] = found[:, -1], first[at[:, 1:]]
    return distance[same], rows[same]


def coverage(
    table: SplatTable,
    points: Float[np.ndarray, "m 3"],
    owners: Int[np.ndarray, " m"],
    supports: Bool[np.ndarray, " n"],
    longest: Float[np.ndarray, " m"],
) -> Float64[np.ndarray, " m"]:
    """The sum of the alphas, at each point, of the Gaussians near it but its owner: of those that
    `supports`, and of others whose longest axis is at most `longest`.

    A disc counts as a ball of its middle radius: it covers a point that is just off its surface.
    Gaussians are searched in classes of similar size: a wide one covers points far from its centre.
    """
    from scipy.spatial import cKDTree

    ordered = np.sort(table.scales, 1)
    thick, reach = np.maximum(table.scales, ordered[:, 1:2]), ordered[:, 2]
    size = np.floor(np.log2(np.maximum(reach, np.finfo(np.float32).tiny))).astype(np.int64)
    total = np.zeros(len(points))
    for each in np.unique(size).tolist():
        rows = np.flatnonzero(size == each)
        tree = cKDTree(table.means[rows])
        k, bound = min(NEIGHBOURS + 1, len(rows)), REACH * 2.0 ** (each + 1)
        for start in range(0, len(points), AT_ONCE):
            part = points[start : start + AT_ONCE]
            distance, at = tree.query(part, k=range(1, k + 1), distance_upper_bound=bound)
            near = np.isfinite(distance)
            point, other = start + np.nonzero(near)[0], rows[at[near]]
            good = supports[other] | (reach[other] <= longest[point])
            good &= other != owners[point]
            point, other = point[good], other[good]
            local = np.einsum(
                "mi,mij->mj", points[point] - table.means[other], rotations(table.quats[other])
            )
            inside = np.exp(-0.5 * np.square(local / thick[other]).sum(1))
            total += np.bincount(point, table.opacities[other] * inside, len(points))
    return total


def _places(
    means: Float[np.ndarray, "n 3"],
) -> tuple[Int64[np.ndarray, " u"], Int64[np.ndarray, " n"]]:
    """A row of each distinct position, and which of these each Gaussian is at."""
    order = np.lexsort(means.T)
    new = np.ones(len(means), bool)
    new[1:] = (means[order[1:]] != means[order[:-1]]).any(1)
    same = np.empty(len(means), np.int64)
    same[order] = np.cumsum(new) - 1
    return order[new], same
