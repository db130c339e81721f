"""The plane that an object stands on: ground, table, plinth. `n` points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from gsedit.scene.planes import planes_through, refined_plane
from gsedit.scene.quantiles import extent_of

TRIPLES = 400
"""Planes that are tried, each through three points: a third of the points on one plane give 15."""
MOST_POINTS = 4000
"""Points that vote: more change no plane, and cost time."""
NEAR = (0.15, 0.4)
"""How far the surroundings reach from the object, of its extent; the second where the first hold
no plane, for an object that hovers."""
TOLERANCE = 0.01
"""Distance at which a point is on a plane while planes are tried, of the object's extent."""
LEAST_SHARE = 0.1
"""Least share of the surroundings that is on the plane: less is no ground."""
LEAST_SPREAD = 0.08
"""Least standard deviation, across, of the points on the plane, of the object's extent: a strip a
quarter as wide as the object is long. What is narrower is another part of it, as a hand."""
ABOVE = 0.97
"""Least share of the object that is above the plane."""
TOUCHING = 0.25
"""Largest height of the object's lowest parts over the plane, of its extent."""
MARGIN_MADS = 1.0
"""Height from which a point is above the plane, in median distances of the points on it."""
LEAST_MARGIN = 0.0025
"""Least such height, of the object's extent: a toe is higher."""


@dataclass(frozen=True, eq=False)
class Support:
    """A plane with the object on its positive side."""

    normal: Float64[np.ndarray, "3"]
    offset: float
    margin: float
    """Height up to which points belong to the plane: it is rough."""

    def heights(self, points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        return points.astype(np.float64) @ self.normal - self.offset

    def above(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points that are clear of the plane, on the object's side."""
        return self.heights(points) > self.margin


def within(
    points: Float[np.ndarray, "n 3"], object_: Bool[np.ndarray, " n"], distance: float
) -> Bool[np.ndarray, " n"]:
    """Flag the points no farther than a distance from the object, its own included."""
    from scipy.spatial import KDTree

    tree = KDTree(points[object_])
    return np.isfinite(tree.query(points, distance_upper_bound=distance)[0])


def find_support(
    points: Float[np.ndarray, "n 3"],
    object_: Bool[np.ndarray, " n"],
    weights: Float[np.ndarray, " n"],
) -> Support | None:
    """The plane of the object's surroundings that it stands on; None where there is none.

    Planes through three points are tried (RANSAC with a fixed seed): the one wins that most of the
    weight near the object is on, among those that have the object on one side.
    """
    points = points.astype(np.float64)
    body = points[object_]
    extent = extent_of(body)
    random = np.random.default_rng(0)
    body = body[random.integers(len(body), size=MOST_POINTS)]
    for near in NEAR:
        ring = np.flatnonzero(within(points, object_, near * extent) & ~object_ & (weights > 0))
        if not len(ring):
            continue
        share = weights[ring] / weights[ring].sum()
        voters = points[random.choice(ring, MOST_POINTS, p=share)]  # by weight: one vote each
        found = _best_plane(voters, body, extent, random)
        if found is not None:
            return found
    return None


def _best_plane(
    voters: Float64[np.ndarray, "v 3"],
    body: Float64[np.ndarray, "b 3"],
    extent: float,
    random: np.random.Generator,
) -> Support | None:
    """The plane with most voters, of those that may carry the body; None without any."""
    tolerance = TOLERANCE * extent
    a, b, c = voters[random.integers(len(voters), size=(3, TRIPLES))]
    normals, offsets = planes_through(a, b, c)
    side = np.copysign(1.0, np.median(body @ normals.T - offsets, axis=0))
    normals, offsets = normals * side[:, None], offsets * side
    lowest = np.quantile(body @ normals.T - offsets, 1 - ABOVE, axis=0)
    votes = (np.abs(voters @ normals.T - offsets) < tolerance).mean(0)
    votes[(lowest < -tolerance) | (lowest > TOUCHING * extent)] = 0
    for best in votes.argsort()[::-1]:
        if votes[best] < LEAST_SHARE:
            return None
        on = voters[np.abs(voters @ normals[best] - offsets[best]) < tolerance]
        if np.linalg.eigvalsh(np.cov(on.T))[1] > (LEAST_SPREAD * extent) ** 2:
            return _refined(voters, normals[best], float(offsets[best]), extent)
    return None


def _refined(
    voters: Float64[np.ndarray, "v 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
    extent: float,
) -> Support:
    """The plane fitted to the voters that are on it, and how rough it is."""
    normal, offset = refined_plane(voters, normal, offset, TOLERANCE * extent)
    distance = np.abs(voters @ normal - offset)
    rough = float(np.median(distance[distance < TOLERANCE * extent]))
    return Support(normal, offset, max(MARGIN_MADS * rough, LEAST_MARGIN * extent))
