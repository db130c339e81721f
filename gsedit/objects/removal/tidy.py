"""Selections as people make them: without what is surely a slip. `n` Gaussians."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quantiles import extent_of

NEIGHBORS = 16
"""Nearest Gaussians that vote on one."""
FEW, MOST = 0.2, 0.8
"""Share of them inside, below which one is not, and above which it is."""
MARGIN = 0.1
"""Width around the object in which flags are looked at, of its extent."""
CORE = 0.035
"""Distance from all that is outside, of the extent, from which a Gaussian is surely inside."""
LEAST_CORE = 0.3
"""Least share of the object that is its core: else it is thin, and all of it is."""


def tidied(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The flags without single ones that are unlike their neighbors; at least one stays."""
    tidy, near = inside.copy(), _near(points, inside)
    for rows, among in ((near, near), (inside & ~near, np.ones_like(near))):
        at, of = np.flatnonzero(rows), np.flatnonzero(among)
        if len(at) and len(of) > NEIGHBORS:
            _, found = k_nearest(points[of], points[at], NEIGHBORS + 1)
            share = inside[of][found[:, 1:]].mean(1)
            tidy[at] = (share > MOST) | (inside[at] & (share >= FEW))
    return tidy if tidy.any() and not tidy.all() else inside


def core_of(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The Gaussians that are inside even if too much was selected; all, of a thin object."""
    near = _near(points, inside) & ~inside
    if not near.any():
        return inside
    width = CORE * extent_of(points[inside])
    away = k_nearest(points[near], points[inside], 1, width)[0][:, 0]
    core = np.zeros_like(inside)
    core[np.flatnonzero(inside)[np.isinf(away)]] = True
    return core if core.sum() > LEAST_CORE * inside.sum() else inside


def _near(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians in the box of nearly all of the object, and a margin around it."""
    low, high = np.quantile(points[inside], (0.02, 0.98), axis=0)
    margin = MARGIN * float(np.linalg.norm(high - low))
    return ((points >= low - margin) & (points <= high + margin)).all(1)
