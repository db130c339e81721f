"""Gaussians that belong to an object beyond what was selected, or hang on it: its rim and floaters,
its mirror image, parts that a selection missed, what stands between its feet or on top of it.

`n` Gaussians, `k` points of the object.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from gsedit.change.objects.removal.cells import (
    closed,
    enclosing,
    parts_of,
    rectangle_around,
    widened,
)
from gsedit.scene.neighbors import extent_of, k_nearest, linked
from gsedit.scene.planes import Plane
from gsedit.select.layers import numbered
from gsedit.select.segment import Segments
from gsedit.select.subject import block_under
from gsedit.select.surfaces import Surfaces

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


SHOWN = 1e-3
"""Pixels that a Gaussian contributes at least to all views, for them to say something of it."""
UNSEEN = 0.15
"""Share of what a Gaussian now contributes, up to which nobody saw it behind the object."""
UNSURE, SURE = 0.5, 0.6
"""Such shares up to which it was seen too little to be believed, and from which it is."""
RIM = 0.06
"""Farthest that the object's rim reaches, of its extent."""
TOUCHED = 0.03
"""Farthest that remains of the object's foot reach on a plane, of its extent."""
AROUND = 0.4
"""Farthest that a Gaussian is believed to look like what was hidden, of the extent."""
OUTLINED = 0.9
"""Share of what it contributes that is in the object's outlines, from which it is enclosed."""
FAINT, HAZE, HAZE_OUTLINED = 0.3, 0.15, 0.6
"""Opacity of haze, its farthest reach, of the extent, and its least share in the outlines."""
ALIKE, ALIKE_SHARE, LEAST_SURE = 0.06, 0.01, 50
"""Distance of two colors that are alike, the share of the sure ones that must be alike, and the
least number of them that says something."""


def strays(
    points: Float[np.ndarray, "n 3"],
    colors: Float[np.ndarray, "n 3"],
    opacities: Float[np.ndarray, " n"],
    thing: Float[np.ndarray, "k 3"],
    extent: float,
    seen: Float[np.ndarray, " n"],
    now: Float[np.ndarray, "3 n"],
    planes: Sequence[Plane],
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians that go with the object.

    `thing` are points of the object, `extent` its own, `seen` what each Gaussian contributed
    while the object was there, `now` what it does without (`contributions_of`). Those go that
    nobody saw, on a plane or near the object; near it, what is enclosed and on no plane; haze that
    is seen before the object more than beside it; and on a plane, what was hardly seen under the
    object, or touches it, and does not look like it: remains of a foot or a shadow.
    """
    all_, outlined, _ = now
    away = k_nearest(thing, points, 1, AROUND * extent)[0][:, 0] / extent
    total = np.maximum(all_, SHOWN)
    trust = np.where(all_ < SHOWN, 1.0, seen / total)
    enclosed = outlined > OUTLINED * total
    layers = [plane.on(points) for plane in planes]
    flat = np.any(layers, 0) if layers else np.zeros(len(points), bool)
    close = away < RIM
    gone = (trust < UNSEEN) & (flat | close) | (enclosed & close & ~flat)
    haze = (opacities < FAINT) & (away < HAZE) & ~flat
    gone |= haze & (outlined > HAZE_OUTLINED * total) & (trust < SURE)
    for plane, layer in zip(planes, layers):
        touched = away < TOUCHED
        under = np.zeros_like(layer)
        shade = thing - plane.heights(thing)[:, None] * plane.normal
        under[layer] = np.isfinite(k_nearest(shade, points[layer], 1, HAZE * extent)[0][:, 0])
        sure = np.flatnonzero(layer & (away < AROUND) & ~touched & (trust > SURE))
        asked = np.flatnonzero(layer & ((under & (trust < UNSURE)) | touched) & ~gone)
        if len(sure) >= LEAST_SURE and len(asked):
            k = max(1, int(ALIKE_SHARE * len(sure)))
            gone[asked[k_nearest(colors[sure], colors[asked], k)[0][:, -1] > ALIKE]] = True
    return gone


ASKED = 2000
"""Points that are asked for their image or their neighbors."""
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


CELL, LOW_PART = 0.04, 0.12
"""Side of a cell from above, and height over the ground up to which parts lie between the feet of
an object, of its extent."""
WITHIN, AROUND_IT, OPEN = 0.9, 8, 0.5
"""Least share of such a part that is within the object's outline from above, the cells around the
object that are looked at, and the share of its rectangle that an open part fills."""


def between_feet(
    thing: Float[np.ndarray, "k 3"], others: Float[np.ndarray, "n 3"], plane: Plane
) -> Bool[np.ndarray, " n"]:
    """Flag the points of what stands low on a plane, within a thing's outline from above, and
    touches its feet, as the beams between the legs of a table.

    What is wholly below the thing carries it, and stays, unless it is open, as crossed beams.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    axes = np.linalg.svd(plane.normal[None])[2][1:]
    own, heights = plane.heights(thing), plane.heights(others)
    step = CELL * extent
    flat = thing @ axes.T / step
    least = flat.min(0) - AROUND_IT
    shape = np.ceil(flat.max(0) - least).astype(int) + AROUND_IT

    def cells(points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 2"]:
        return np.floor(points @ axes.T / step - least).astype(int)

    foot, outline, taken = (np.zeros(shape, bool) for _ in range(3))
    foot[tuple(cells(thing[own < LOW_PART * extent]).T)] = True
    outline[tuple(cells(thing).T)] = True
    outline = enclosing(closed(outline, 2))
    at = cells(others)
    near = np.flatnonzero(((at >= 0) & (at < shape)).all(1) & (heights > plane.band))
    at, near_low = at[near], heights[near] < LOW_PART * extent
    taken[tuple(at[near_low].T)] = True
    numbers, _ = parts_of(taken)
    part, beside = numbers[tuple(at.T)], np.unique(numbers[widened(foot, 1) & (numbers > 0)])
    for each in beside:
        own_low, high = (near[(part == each) & which] for which in (near_low, ~near_low))
        inside = outline[numbers == each].mean() >= WITHIN and len(high) < len(own_low) / 2
        is_open = (numbers == each).sum() < OPEN * rectangle_around(numbers == each).sum()
        flags[own_low] = inside and (is_open or np.median(heights[own_low]) > own.min())
    return flags


MOSTLY, LEAST_JOINT = 0.5, 3
"""Least share of an object that is selected, for the rest of it to be meant, and the least pairs of
neighbors that join the two."""


def missed(
    surfaces: Surfaces, segments: Segments, inside: Bool[Tensor, " n"]
) -> Bool[np.ndarray, " m"]:
    """Flag the surfaces that a selection of most of an object missed: parts of the same object that
    are joined to what is selected. What is wholly below that carries it, and stays."""
    chosen = surfaces.gathered(inside) & surfaces.solid
    if not chosen.any():
        return chosen
    own = segments.inside(int(segments.labels[torch.from_numpy(chosen)].mode().values)).numpy()
    own &= surfaces.solid & (chosen | ~block_under(surfaces, own))
    rest, kept = own & ~chosen, own & chosen
    if kept.sum() < MOSTLY * own.sum() or not rest.any():
        return np.zeros_like(own)
    part = numbered(linked(surfaces.edges[rest[surfaces.edges].all(1)], len(surfaces)), rest)
    joints = np.bincount(part[rest], surfaces.touches(rest, kept)[rest])
    high = surfaces.heights > np.quantile(surfaces.heights[kept], 0.01)
    above = np.bincount(part[rest], high[rest]) > 0.5 * np.bincount(part[rest])
    return rest & ((joints >= LEAST_JOINT) & above)[part]


def left_on(
    surfaces: Surfaces, segments: Segments, gone: Bool[Tensor, " n"]
) -> Bool[np.ndarray, " m"]:
    """Flag the surfaces of things that stand on one that is gone, and are left themselves."""
    lost, labels = surfaces.gathered(gone), segments.labels.numpy()
    count = len(segments.rows)
    share = np.bincount(labels, lost, count) / np.bincount(labels, minlength=count)
    under = [row.stands_on for row in segments.rows]
    on = [i for i in range(count) if under[i] >= 0 and share[under[i]] > MOSTLY >= share[i]]
    return np.isin(labels, on) & ~lost
