"""Find what stood on an object, and hangs in the air once that is gone. `n` Gaussians."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy import ndimage

from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quantiles import extent_of

REACH = 1.0
"""Width around the object's box that is looked at, of its extent."""
CELL, SPACED = 0.04, 2.5
"""Least side of a cell, of the extent, and of the usual distance of neighbors."""
ASKED = 2000
"""Points that are asked for their neighbors."""
LOW = 0.1
"""Height to which what stands beside the object reaches down, of the object's."""
LEAST_SIZE = 0.1
"""Least extent of what is worth a word, of the object's: less is a crumb of its rim."""


def resting_on(
    thing: Float[np.ndarray, "k 3"],
    others: Float[np.ndarray, "n 3"],
    up: Float64[np.ndarray, "3"],
) -> Bool[np.ndarray, " n"]:
    """Flag the points of what lies right on top of a thing and touches nothing beside or below.

    `others` are the points that are left; what reaches down beside the thing, or far from it, is
    held by something else.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    axes = np.linalg.svd(up[None])[2]
    axes[0] = up
    own, rest = thing @ axes.T, others.astype(np.float64) @ axes.T
    low, high = own.min(0) - REACH * extent, own.max(0) + REACH * extent
    low[0] = own[:, 0].min() + LOW * np.ptp(own[:, 0])
    near = np.flatnonzero(((rest > low) & (rest < high)).all(1))
    if len(near) < 2 or extent <= 0:
        return flags
    some = rest[near[:: 1 + len(near) // ASKED]]
    spacing = float(np.median(k_nearest(rest[near], some, 2)[0][:, 1]))
    step = max(CELL * extent, SPACED * spacing)

    def cells(points: Float[np.ndarray, "m 3"]) -> tuple[np.ndarray, ...]:
        return tuple(((points - low) / step).astype(int).T)

    taken, filled = (np.zeros(np.ceil((high - low) / step).astype(int), bool) for _ in range(2))
    taken[cells(rest[near])] = True
    filled[cells(own[own[:, 0] > low[0]])] = True
    found: Any = ndimage.label(taken, np.ones((3, 3, 3)))
    parts = found[0]
    above = np.zeros_like(filled)
    above[2:] = filled[1:-1] | filled[:-2]
    inner = np.zeros_like(filled)
    inner[1:-1, 1:-1, 1:-1] = True
    loose = np.setdiff1d(parts[above & ~filled], np.append(parts[~inner], 0))
    for part in loose:
        rows = near[parts[cells(rest[near])] == part]
        flags[rows] = extent_of(others[rows]) > LEAST_SIZE * extent
    return flags
