"""The ground of a scene: the plane that many splats lie on and few lie under."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.files.table import SplatTable
from gsedit.points.order import importance

SAMPLE = 20_000
"""Splats that are looked at, drawn by opacity times area."""
TRIES = 2_000
"""Planes through three of them: with one splat in seven on the ground, 5 or more fit it."""
THICKNESS = 0.01
"""Of the median distance from the middle: how far off a plane a splat may lie."""
FEW = 4_000
"""Of them, those that the planes are tried on."""
LEAST = 0.02
"""Share of the splats that a ground holds."""
TILT = 35.0
"""Degrees that the ground may lean against an upward direction that is given."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Points p with normal . p = height; the normal points up, to where the scene is."""

    normal: Float64[np.ndarray, "3"]
    height: float
    share: float
    """Of the splats, by opacity times area, that lie on it."""
    above: float
    """Share of the others that lie above."""


def find_ground(table: SplatTable, up: Float64[np.ndarray, "3"] | None = None) -> Plane:
    """The plane with most splats on it times the share of the others above it.

    `up` limits the planes to those within TILT of level. RANSAC with a fixed seed, then least
    squares. Raises UsageError where no plane holds LEAST of the scene.
    """
    points = _sample(table)
    thickness = THICKNESS * float(np.median(np.linalg.norm(points - np.median(points, 0), axis=1)))
    best = _best_of_three(points[:FEW], thickness, up)
    if best is None or best.share < LEAST:
        raise UsageError("no ground was found: name what is up, or turn by transform --rotate")
    for _ in range(5):
        inside = np.abs(points @ best.normal - best.height) < thickness
        middle = points[inside].mean(0)
        normal = np.linalg.svd(points[inside] - middle, full_matrices=False)[2][2]
        best = _judge(points, normal, middle, thickness, best.normal)
    return best


def _best_of_three(
    points: Float64[np.ndarray, "n 3"], thickness: float, up: Float64[np.ndarray, "3"] | None
) -> Plane | None:
    """Of planes through three of the points, the best."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(lengths, np.finfo(np.float64).tiny)[:, None]
    level = lengths > 0
    if up is not None:
        level &= np.abs(normals @ up) > np.cos(np.radians(TILT))
    planes = [
        _judge(points, normal, corner, thickness, up)
        for normal, corner in zip(normals[level], corners[level, 0])
    ]
    return max(planes, key=lambda plane: plane.share * plane.above**4, default=None)


def _sample(table: SplatTable) -> Float64[np.ndarray, "n 3"]:
    weight = np.nan_to_num(importance(table), posinf=0.0) * np.isfinite(table.means).all(1)
    if np.count_nonzero(weight) < 10:
        raise UsageError("a scene of so few visible splats has no ground")
    # giants must not decide alone
    weight = np.minimum(weight, 10 * np.median(weight[weight > 0]))
    rows = np.random.default_rng(0).choice(len(weight), SAMPLE, p=weight / weight.sum())
    return table.means[rows].astype(np.float64)


def _judge(
    points: Float64[np.ndarray, "n 3"],
    normal: Float64[np.ndarray, "3"],
    corner: Float64[np.ndarray, "3"],
    thickness: float,
    up: Float64[np.ndarray, "3"] | None,
) -> Plane:
    """The plane through `corner`, its normal towards `up`, or else towards most points."""
    off = (points - corner) @ normal
    share = float(np.mean(np.abs(off) < thickness))
    over, under = np.mean(off > thickness), np.mean(off < -thickness)
    turn = normal @ up < 0 if up is not None else under > over
    if turn:
        normal, over, under = -normal, under, over
    above = float(over / max(over + under, 1e-9))
    return Plane(normal, float(normal @ corner), share, above)
