"""Shifts by which a texture repeats itself, and those that reach into a hole.

Statistics of patch offsets (He and Sun 2012): patches that are alike lie apart by few shifts, where
a texture has a structure. A picture has `h w` pixels; a shift is (rows, columns) from a pixel to
where it is copied from.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import binary_erosion, gaussian_filter, maximum_filter
from scipy.spatial import KDTree

PATCH = 5
"""Side of a patch, pixels."""
COMPONENTS = 12
"""Principal components by which patches are compared."""
MOST_PATCHES = 6000
"""Patches that are compared; more change no statistics."""
NEIGHBORS = 12
"""Patches that are asked for, to find one that is not the same place."""
REPEATED, REACHING = 24, 24
"""Shifts taken from what repeats, and from what covers most of the hole."""


def find_shifts(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
) -> Int64[np.ndarray, "k 2"]:
    """Shifts from pixels of a hole to known ones; none is zero, some reach most of the hole."""
    covers = _coverage(known, hole)
    shifts = [*_peaks(_repeats(picture, known) * (covers > 0), REPEATED)]
    shifts += _reaching(known, hole, covers)
    return np.unique(np.array(shifts, np.int64).reshape(-1, 2), axis=0)


def shifted(mask: Bool[np.ndarray, "h w"], shift: Int64[np.ndarray, "2"]) -> np.ndarray:
    """Flag the pixels whose place after a shift is flagged."""
    h, w = mask.shape
    out = np.zeros_like(mask)
    y, x = (int(each) for each in shift)
    rows, columns = slice(max(0, -y), min(h, h - y)), slice(max(0, -x), min(w, w - x))
    from_rows, from_columns = slice(max(0, y), min(h, h + y)), slice(max(0, x), min(w, w + x))
    if rows.start < rows.stop and columns.start < columns.stop:
        out[rows, columns] = mask[from_rows, from_columns]
    return out


def _coverage(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "a b"]:
    """Pixels of the hole that each shift, of -h..h by -w..w, takes to known ones."""
    shape = (2 * hole.shape[0], 2 * hole.shape[1])
    there, here = (np.fft.rfft2(mask.astype(np.float64), shape) for mask in (known, hole))
    return np.fft.fftshift(np.round(np.fft.irfft2(there * here.conj(), shape)))


def _repeats(
    picture: Float[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "a b"]:
    """How many patches find their like by each shift, smoothed; as large as `_coverage`."""
    h, w = known.shape
    votes = np.zeros((2 * h, 2 * w))
    half = PATCH // 2
    inner = binary_erosion(known, np.ones((PATCH, PATCH)))
    places = np.argwhere(inner)
    if len(places) <= NEIGHBORS:
        return votes
    places = places[:: 1 + len(places) // MOST_PATCHES]
    windows = np.lib.stride_tricks.sliding_window_view(picture, (PATCH, PATCH), (0, 1))
    patches = windows[places[:, 0] - half, places[:, 1] - half].reshape(len(places), -1)
    patches = patches - patches.mean(0)
    axes = np.linalg.eigh(patches.T @ patches)[1][:, -COMPONENTS:]
    reduced = patches @ axes
    _, near = KDTree(reduced).query(reduced, k=NEIGHBORS, workers=-1)
    offsets = places[near] - places[:, None]
    far = np.abs(offsets).max(-1) > max(h, w) / 15
    first = far.argmax(1)
    found = offsets[np.arange(len(places)), first][far.any(1)]
    np.add.at(votes, (found[:, 0] + h, found[:, 1] + w), 1)
    return gaussian_filter(votes, 1.0)


def _peaks(votes: Float[np.ndarray, "a b"], count: int) -> Int64[np.ndarray, "k 2"]:
    """The shifts of the highest local maxima of a map of votes."""
    top = (votes == maximum_filter(votes, 5)) & (votes > 0)
    rows = np.argwhere(top)
    best = rows[np.argsort(-votes[top], kind="stable")[:count]]
    return best - np.array(votes.shape) // 2


def _reaching(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"], covers: np.ndarray
) -> list[Int64[np.ndarray, "2"]]:
    """Shifts that take all of the hole to known pixels, one after the other the widest-reaching."""
    left, shifts = hole.copy(), []
    while left.any() and len(shifts) < REACHING:
        covers = covers if not shifts else _coverage(known, left)
        if covers.max() < 1:
            break
        at = np.array(np.unravel_index(covers.argmax(), covers.shape)) - np.array(hole.shape)
        shifts.append(at)
        left &= ~shifted(known, at)
    more = _peaks(covers * 0 + _coverage(known, hole), REACHING)
    return [*shifts, *more]
