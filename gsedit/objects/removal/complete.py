"""A picture with a hole, completed from its own texture: copied in large parts, blended in light.

The hole's pixels are copied from known ones by a few shifts (gsedit.objects.removal.shifts), with
seams where they show least; then light is evened by gradients. `h w` pixels in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import binary_dilation

from gsedit.objects.removal.labels import NEVER, best_labels
from gsedit.objects.removal.membrane import pixel_pairs, solve_membrane
from gsedit.objects.removal.shifts import find_shifts

MOST_LABELED = 2500
"""Pixels of a hole whose shifts are searched; a larger hole is searched in a smaller picture."""
ODD = 4.5
"""Distance from the middle color, of the median distance, from which a pixel is not copied."""
LEAST_KNOWN = 0.15
"""Least known pixels, of the hole's, from which its texture is made up."""


@dataclass(frozen=True, eq=False)
class Completed:
    """A picture without its hole."""

    picture: Float[np.ndarray, "h w 3"]
    source: Int64[np.ndarray, "h w 2"]
    """Row and column that each pixel is copied from; its own where it is known."""
    textured: bool
    """Whether texture was copied; else the hole is smooth."""


def complete(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
) -> Completed:
    """Fill a hole from what is known; pixels that are neither are read and written nowhere."""
    own = np.stack(np.indices(hole.shape), -1)
    if not hole.any() or not known.any():
        return Completed(picture, own, False)
    smooth = solve_membrane(picture, hole, known)
    if known.sum() < LEAST_KNOWN * hole.sum():
        return Completed(smooth, own, False)
    factor = int(np.ceil(np.sqrt(hole.sum() / MOST_LABELED)))
    small, small_known, small_hole = _reduced(picture, known, hole, factor)
    small_known &= ~_odd(small, small_known)
    shifts = find_shifts(small, small_known, small_hole)
    if not len(shifts) or not small_hole.any():
        return Completed(smooth, own, False)
    chosen = _labels(small, small_known, small_hole, shifts)
    field = np.zeros((*small_hole.shape, 2), np.int64)
    field[small_hole] = shifts[chosen]
    source = own.copy()
    fine = np.kron(field, np.ones((factor, factor, 1), np.int64))[: len(hole), : hole.shape[1]]
    source[hole] += factor * fine[hole]
    return _blended(picture, known, hole, source, smooth)


def _odd(picture: Float[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """Pixels unlike most others: a leaf or a stain, which would show as a copy."""
    if not known.any():
        return known
    middle = np.median(picture[known], 0)
    away = np.linalg.norm(picture - middle, axis=-1)
    return binary_dilation(known & (away > ODD * np.median(away[known])))


def _reduced(picture, known, hole, factor: int):
    """Means of the known pixels of blocks; a block is known if all of it is."""
    if factor == 1:
        return picture, known, hole
    h, w = (-(-side // factor) for side in hole.shape)
    pad = ((0, h * factor - hole.shape[0]), (0, w * factor - hole.shape[1]))

    def blocks(values):
        extra = ((0, 0),) * (values.ndim - 2)
        padded = np.pad(values, (*pad, *extra))
        return padded.reshape(h, factor, w, factor, *values.shape[2:])

    counts = blocks(known.astype(np.float64)).sum((1, 3))
    sums = blocks(np.where(known[..., None], picture, 0)).sum((1, 3))
    holes = blocks(hole).any((1, 3))
    whole = (counts >= factor * factor) & ~holes
    return sums / np.maximum(counts, 1)[..., None], whole, holes


def _labels(picture, known, hole, shifts) -> Int64[np.ndarray, " p"]:
    """The shift of each pixel of the hole."""
    places = np.argwhere(hole)
    size = np.array(hole.shape)
    at = places[None] + shifts[:, None]
    within = ((at >= 0) & (at < size)).all(-1)
    at = np.clip(at, 0, size - 1)
    usable = within & known[at[..., 0], at[..., 1]]
    values = np.where(usable[..., None], picture[at[..., 0], at[..., 1]], 0.5)
    single = np.where(usable, 0.0, NEVER)
    number = np.full(hole.shape, -1)
    number[hole] = np.arange(len(places))
    pairs = pixel_pairs(hole, known)
    a, b = (number.reshape(-1)[pairs[:, i]] for i in (0, 1))
    flat = picture.reshape(-1, 3)
    for inside, outside in ((a, pairs[:, 1]), (b, pairs[:, 0])):
        rim = (inside >= 0) & (number.reshape(-1)[outside] < 0)
        index, rows = inside[rim], outside[rim]
        seen = np.stack(np.unravel_index(rows, hole.shape), -1)[None] + shifts[:, None]
        inner = ((seen >= 0) & (seen < size)).all(-1)
        seen = np.clip(seen, 0, size - 1)
        inner &= known[seen[..., 0], seen[..., 1]]
        step = np.linalg.norm(picture[seen[..., 0], seen[..., 1]] - flat[rows], axis=-1)
        cost = np.where(inner, 2 * step, 2.0)
        for k in range(len(shifts)):
            np.add.at(single[k], index, cost[k])
    both = (a >= 0) & (b >= 0)
    return best_labels(single, values, np.stack((a[both], b[both]), 1))


def _blended(picture, known, hole, source, smooth) -> Completed:
    """Copies by gradients: their steps inside, the known values at the border."""
    size = np.array(hole.shape)
    pairs = pixel_pairs(hole, known)
    offset = (source - np.stack(np.indices(hole.shape), -1)).reshape(-1, 2)
    total = np.zeros((len(pairs), 3))
    votes = np.zeros((len(pairs), 1))
    for end in (0, 1):  # the shift of either pixel says how the two differ
        own = hole.reshape(-1)[pairs[:, end]]
        ends = [np.stack(np.unravel_index(pairs[:, i], hole.shape), -1) for i in (0, 1)]
        moved = [each + offset[pairs[:, end]] for each in ends]
        fits = own & np.all([((m >= 0) & (m < size)).all(-1) for m in moved], 0)
        first, second = (np.clip(m, 0, size - 1) for m in moved)
        fits &= known[first[:, 0], first[:, 1]] & known[second[:, 0], second[:, 1]]
        step = picture[second[:, 0], second[:, 1]] - picture[first[:, 0], first[:, 1]]
        total += np.where(fits[:, None], step, 0)
        votes += fits[:, None]
    blended = solve_membrane(smooth, hole, known, (pairs, total / np.maximum(votes, 1)))
    low, high = picture[known].min(0), picture[known].max(0)
    return Completed(np.where(hole[..., None], np.clip(blended, low, high), picture), source, True)
