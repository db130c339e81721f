"""The order along a Z curve: rows that are near in space become near in the file."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int, UInt64


def morton_order(means: Float32[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """The rows along the Z curve of their bounding box; equal places keep their order.

    Rows that are not finite come last.
    """
    return np.argsort(morton_codes(means), kind="stable")


def morton_codes(means: Float32[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """The place of each row on the Z curve of the finite rows' bounding box."""
    finite = np.asarray(np.isfinite(means).all(1))
    if not finite.any():
        return np.zeros(len(means), np.uint64)
    inside = means if finite.all() else means[finite]
    low = inside.min(0).astype(np.float64)
    size = np.maximum(inside.max(0) - low, np.finfo(np.float32).tiny)
    with np.errstate(invalid="ignore", over="ignore"):
        cells = (means - low) / size * ((1 << 21) - 1)  # 63 bits of 64
    codes = interleave(np.where(finite[:, None], cells, 0))
    codes[~finite] = np.uint64(0xFFFFFFFFFFFFFFFF)
    return codes


def interleave(cells: np.ndarray) -> UInt64[np.ndarray, " n"]:
    """Morton codes of integer cells (n 3, from 0 to 2^21 - 1); x has the lowest bit."""
    codes = np.zeros(len(cells), np.uint64)
    for axis in range(3):
        codes |= _spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis)
    return codes


def _spread(cells: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Numbers with two zero bits after each of their lowest 21 bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    return cells
