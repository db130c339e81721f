"""Find the mirror image of an object under a plane: how captures explain a glossy floor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64

from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quantiles import extent_of

ASKED = 2000
"""Points of the object that are asked for their image."""
NEAR = 0.08
"""Farthest that an image lies from where it belongs, of the object's extent."""
LOW = 0.5
"""Share of the object's height whose image is asked for: that of its top is seen least."""
SHARE = 0.6
"""Share of those points that have one: less is a leg of the table, or the soil."""
ASIDE, ALONE = 0.75, 0.5
"""Shift to four sides, of the extent, and the largest share of points that are found there, of
those found below: where all is full of points, as of ground below the top of a rock, none is an
image."""
CLEAR = 0.05
"""Depth under the plane from which there is an image, of the extent: less is the surface itself."""


def mirrored_under(
    thing: Float[np.ndarray, "k 3"],
    others: Float[np.ndarray, "n 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
) -> Bool[np.ndarray, " n"]:
    """Flag the points under a plane that are the mirror image of a thing on it; none if few are.

    `normal` (a unit vector) points to the thing's side; points p of the plane have p @ normal ==
    offset.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    heights = others.astype(np.float64) @ normal - offset
    high = thing.astype(np.float64) @ normal - offset
    under = np.flatnonzero((heights < -CLEAR * extent) & (heights > -high.max() - NEAR * extent))
    asked = thing[(high > CLEAR * extent) & (high < LOW * high.max())]
    if not len(under) or not len(asked):
        return flags
    images = others[under] - 2 * heights[under, None] * normal
    some = asked[:: 1 + len(asked) // ASKED]
    share = _share(images, some, extent)
    across = np.linalg.svd(normal[None])[2][1:] * ASIDE * extent
    beside = [_share(images, some + way, extent) for way in (*across, *-across)]
    if share < SHARE or np.median(beside) > ALONE * share:
        return flags
    flags[under] = np.isfinite(k_nearest(thing, images, 1, NEAR * extent)[0][:, 0])
    return flags


def _share(
    images: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "k 3"], extent: float
) -> float:
    """Share of points that have an image near them."""
    return float(np.isfinite(k_nearest(images, points, 1, NEAR * extent)[0]).mean())
