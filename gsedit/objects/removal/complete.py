"""A picture with a hole, completed from its own texture: copied in large parts, blended in light.

The hole's pixels are copied from known ones by a few shifts (gsedit.objects.removal.shifts), with
seams where they show least; then light is evened by gradients. `h w` pixels; a hole of `p`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64

from gsedit.objects.removal.cells import widened
from gsedit.objects.removal.labels import NEVER, best_labels
from gsedit.objects.removal.membrane import pixel_pairs, solve_membrane
from gsedit.objects.removal.shifts import find_shifts

MOST_LABELED = 2500
"""Pixels of a hole whose shifts are searched; a larger hole is searched in a smaller picture."""
ODD, RARE = 4.5, 0.04
"""Distance from the middle color, of the median distance, from which pixels are not copied, where
they are fewer than this share: more are the texture itself, as mortar."""
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
    own = _places(hole.shape)
    if not hole.any() or not known.any():
        return Completed(picture, own, False)
    smooth = solve_membrane(picture, hole, known)
    if known.sum() < LEAST_KNOWN * hole.sum():
        return Completed(smooth, own, False)
    factor = int(np.ceil(np.sqrt(hole.sum() / MOST_LABELED)))
    small, sources, gap = _reduced(picture, known, hole, factor)
    sources &= ~_odd(small, sources)
    shifts = find_shifts(small, sources, gap)
    if not len(shifts):
        return Completed(smooth, own, False)
    field = np.zeros((*gap.shape, 2), np.int64)
    field[gap] = shifts[_labels(small, sources, gap, shifts)]
    source = own.copy()
    fine = np.kron(field, np.ones((factor, factor, 1), np.int64))[: len(hole), : hole.shape[1]]
    source[hole] += factor * fine[hole]
    return Completed(_blended(picture, known, hole, source, smooth), source, True)


def _places(shape: tuple[int, ...]) -> Int64[np.ndarray, "h w 2"]:
    """Row and column of every pixel."""
    rows, columns = np.indices(shape[:2])
    return np.stack((rows, columns), -1)


def _odd(
    picture: Float[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels unlike most others: a leaf or a stain, which would show as a copy."""
    if not known.any():
        return known
    away = np.linalg.norm(picture - np.median(picture[known], 0), axis=-1)
    odd = known & (away > ODD * np.median(away[known]))
    return widened(odd, 1) if odd.sum() < RARE * known.sum() else np.zeros_like(odd)


def _reduced(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    factor: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Picture, known and hole of blocks; a block is known if all of it is, and a hole if any."""
    rows, columns = (-(-side // factor) for side in hole.shape)
    pad = [(0, rows * factor - hole.shape[0]), (0, columns * factor - hole.shape[1])]

    def blocks(values: np.ndarray) -> np.ndarray:
        """Values by block, a block's own in the last axis but the channels'."""
        padded = np.pad(values, pad + [(0, 0)] * (values.ndim - 2))
        split = padded.reshape(rows, factor, columns, factor, *values.shape[2:])
        return np.moveaxis(split, 2, 1).reshape(rows, columns, factor**2, *values.shape[2:])

    counts = blocks(known).sum(2)
    mean = blocks(np.where(known[..., None], picture, 0)).sum(2) / np.maximum(counts, 1)[..., None]
    gap = np.asarray(blocks(hole).any(2))
    return mean, (counts >= factor**2) & ~gap, gap


def _at(
    places: Int64[np.ndarray, "*b 2"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Int64[np.ndarray, "*b"], Bool[np.ndarray, "*b"]]:
    """Flat indices of places, and whether each is in the picture and flagged."""
    h, w = mask.shape
    within = ((places >= 0) & (places < (h, w))).all(-1)
    flat = np.where(within, places[..., 0] * w + places[..., 1], 0)
    return flat, within & mask.reshape(-1)[flat]


def _labels(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    shifts: Int64[np.ndarray, "k 2"],
) -> Int64[np.ndarray, " p"]:
    """The shift of each pixel of the hole: an index."""
    colors, places = picture.reshape(-1, 3), _places(hole.shape).reshape(-1, 2)
    inside = np.flatnonzero(hole)
    at, usable = _at(places[inside] + shifts[:, None], known)
    values = np.where(usable[..., None], colors[at], 0.5)
    single = np.where(usable, 0.0, NEVER)
    number = np.full(hole.size, -1)
    number[inside] = np.arange(len(inside))
    pairs = pixel_pairs(hole, known)
    for near in (0, 1):  # what a shift shows of a known neighbor should be that neighbor
        own, other = number[pairs[:, near]], pairs[:, 1 - near]
        rim = (own >= 0) & (number[other] < 0)
        own, other = own[rim], other[rim]
        seen, there = _at(places[other] + shifts[:, None], known)
        cost = np.where(there, 2 * np.linalg.norm(colors[seen] - colors[other], axis=-1), 2.0)
        np.add.at(single.T, own, cost.T)
    ends = number[pairs]
    return best_labels(single, values, ends[(ends >= 0).all(1)])


def _blended(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    source: Int64[np.ndarray, "h w 2"],
    smooth: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w 3"]:
    """Copies by gradients: their steps inside, the known values at the border."""
    places = _places(hole.shape)
    shift = (source - places).reshape(-1, 2)
    places, colors = places.reshape(-1, 2), picture.reshape(-1, 3)
    pairs = pixel_pairs(hole, known)
    total, votes = np.zeros((len(pairs), 3)), np.zeros((len(pairs), 1))
    for end in (0, 1):  # the shift of either pixel says how the two differ
        moved = places[pairs] + shift[pairs[:, end]][:, None]
        at, there = _at(moved, known)
        fits = hole.reshape(-1)[pairs[:, end]] & there.all(1)
        step = colors[at[:, 1]] - colors[at[:, 0]]
        total += np.where(fits[:, None], step, 0)
        votes += fits[:, None]
    blended = solve_membrane(smooth, hole, known, (pairs, total / np.maximum(votes, 1)))
    low, high = picture[known].min(0), picture[known].max(0)
    return np.where(hole[..., None], np.clip(blended, low, high), picture)
