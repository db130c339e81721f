"""How near the neighbours of Gaussians are, and how well others cover a point: by k-d trees.

`n` Gaussians, `m` points. Time and memory depend on how many Gaussians there are, not on how far
apart: a scene 10^6 wide costs what a small one does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int64

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
    from scipy.spatial import KDTree

    first, same = _places(means)
    places = means[first].astype(np.float64)
    k = min(k, len(places) - 1)
    if k < 1:
        return np.zeros(len(means)), np.zeros((len(means), 0), np.int64)
    tree = KDTree(places)
    distance, rows = np.empty(len(places)), np.empty((len(places), k), np.int64)
    for start in range(0, len(places), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        found, at = _query(tree, places[part], k + 1)
        distance[part], rows[part] = found[:, -1], first[at[:, 1:]]
    return distance[same], rows[same]


@dataclass(frozen=True, eq=False)
class Covers:
    """Which Gaussians are over which points: `p` pairs."""

    point: Int64[np.ndarray, " p"]
    row: Int64[np.ndarray, " p"]
    alpha: Float64[np.ndarray, " p"]
    """Of the Gaussian at the point."""


def covers(table: SplatTable, points: Float[np.ndarray, "m 3"]) -> Covers:
    """The Gaussians that are over each point, of similar ones the nearest few.

    A disc counts as a ball of its middle radius: it covers a point that is just off its surface.
    Gaussians are searched in classes of similar size: a wide one covers points far from its centre.
    """
    from scipy.spatial import KDTree

    ordered = np.sort(table.scales, 1)
    thick, reach = np.maximum(table.scales, ordered[:, 1:2]), ordered[:, 2]
    size = np.floor(np.log2(np.maximum(reach, np.finfo(np.float32).tiny))).astype(np.int64)
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for each in np.unique(size).tolist():
        rows = np.flatnonzero(size == each)
        tree = KDTree(table.means[rows])
        k, bound = min(NEIGHBOURS + 1, len(rows)), REACH * 2.0 ** (each + 1)
        for start in range(0, len(points), AT_ONCE):
            part = points[start : start + AT_ONCE]
            distance, at = _query(tree, part, k, bound)
            near = np.isfinite(distance)
            point, row = start + np.nonzero(near)[0], rows[at[near]]
            offset = points[point] - table.means[row]
            local = np.einsum("mi,mij->mj", offset, rotations(table.quats[row])) / thick[row]
            alpha = table.opacities[row] * np.exp(-0.5 * np.square(local).sum(1))
            found.append((point, row, alpha))
    return Covers(*(np.concatenate(column) for column in zip(*found)))


def _query(
    tree: Any, points: Float[np.ndarray, "m 3"], k: int, bound: float = np.inf
) -> tuple[Float64[np.ndarray, "m k"], Int64[np.ndarray, "m k"]]:
    """The distances and rows of the k nearest; infinite, and one row too many, beyond `bound`."""
    found = tree.query(points, k=k, distance_upper_bound=bound, workers=-1)
    distance, rows = (np.asarray(each).reshape(len(points), k) for each in found)
    return distance, rows


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
