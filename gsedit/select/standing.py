"""Blocks that things stand on, where both are one segment: rocks of the thing's own color.

`n` Gaussians; world units.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import ConvexHull, QhullError

from gsedit.select.surfaces import Surfaces

SLICES = 24
"""Level slices of a thing."""
TALL, LOW = 0.1, 0.45
"""Least and largest height of a block that it stands on, of the height of both."""
NARROW = 0.5
"""Largest girth of the thing where it stands on the block, of the block's."""
WITHIN = 2
"""Slices within which the girth falls so far."""
SOLID = 0.8
"""Least girth of a block, of the hull around it: feet and legs apart have less."""
SEEN = 0.7
"""Least share of what is seen of both that is above the block."""
FEWEST = 16
"""Least Gaussians of a slice that tells a girth."""


def block_under(surfaces: Surfaces, inside: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Flag the block that the thing inside stands on and is narrower than, as a rock; none if
    there is no such block. `inside` holds both."""
    none = np.zeros_like(inside)
    if inside.sum() < SLICES * FEWEST:
        return none
    heights = surfaces.heights
    low, high = np.quantile(heights[inside], (0.01, 0.99))
    edges = np.linspace(low, high, SLICES + 1)
    girths = [_girth(surfaces, inside, *pair) for pair in pairwise(edges)]
    for i in range(round(TALL * SLICES), round(LOW * SLICES)):
        girth = np.median([girths[j][0] for j in range(i)])
        hull = np.median([girths[j][1] for j in range(i)])
        after = min(each[0] for each in girths[i : i + WITHIN])
        if girth < SOLID * hull or girths[i - 1][0] < NARROW * girth or after > NARROW * girth:
            continue
        block = inside & (heights < edges[i])  # a slice higher would take claws along
        seen = surfaces.seen[inside].sum()
        if surfaces.seen[inside & ~block].sum() >= SEEN * seen:
            return block
    return none


def _girth(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], low: float, high: float
) -> tuple[float, float]:
    """Length of the surface around a level slice, and of the hull around it."""
    rows = np.flatnonzero(inside & (surfaces.heights >= low) & (surfaces.heights < high))
    if len(rows) < FEWEST:
        return 0.0, 0.0
    length = float(surfaces.areas[rows].sum()) / max(high - low, 1e-12)
    return length, _around(surfaces, surfaces.points[rows])


def _around(surfaces: Surfaces, points: Float64[np.ndarray, "m 3"]) -> float:
    """Length of the hull of points, seen from above."""
    front = surfaces.place.front.numpy()
    flat = np.stack((points @ front, points @ np.cross(surfaces.up, front)), 1)
    try:
        return float(ConvexHull(flat).area)  # of a hull in a plane, that is its outline
    except QhullError:
        return 0.0
