"""Volumes that points lie in; their surface is inside. numpy, any float type; NaN is outside."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from gsedit.scene.shapes import Bool, Float


def inside_box(
    points: Float[np.ndarray, "n 3"], low: Sequence[float], high: Sequence[float]
) -> Bool[np.ndarray, " n"]:
    """Flag the points between two corners; a side is open where a corner is infinite."""
    inside = np.ones(len(points), bool)
    for axis in range(3):
        if low[axis] > -inf:
            inside &= points[:, axis] >= low[axis]
        if high[axis] < inf:
            inside &= points[:, axis] <= high[axis]
    return inside


def inside_ball(
    points: Float[np.ndarray, "n 3"], center: Sequence[float], radius: float
) -> Bool[np.ndarray, " n"]:
    """Flag the points at most `radius` from the center."""
    return squared_norm(points - np.array(center, np.float32)) <= np.square(np.float64(radius))


def squared_norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Squared lengths; infinite where they leave the float type."""
    return np.einsum("ij,ij->i", vectors, vectors)
