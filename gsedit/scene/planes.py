"""Planes in clouds of points, normal . p = offset: through three points, and fitted to those near.

`n` points, `k` planes.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

REFINED = 5
"""Least-squares fits to the points that are on a plane, one after the other."""


def planes_through(
    a: Float64[np.ndarray, "t 3"], b: Float64[np.ndarray, "t 3"], c: Float64[np.ndarray, "t 3"]
) -> tuple[Float64[np.ndarray, "k 3"], Float64[np.ndarray, " k"]]:
    """(unit normals, offsets) of the planes through three points each that are not in a line."""
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    return normals, (normals * a[lengths > 0]).sum(1)


def refined_plane(
    points: Float64[np.ndarray, "n 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
    tolerance: float,
) -> tuple[Float64[np.ndarray, "3"], float]:
    """(unit normal on the same side, offset) fitted to the points within `tolerance` of a plane;
    at least three must be."""
    for _ in range(REFINED):
        on = points[np.abs(points @ normal - offset) < tolerance]
        middle = on.mean(0)
        fitted = np.linalg.svd(on - middle, full_matrices=False)[2][2]
        normal = fitted * np.copysign(1.0, fitted @ normal)  # points in a line: also across it
        offset = float(normal @ middle)
    return normal, offset
