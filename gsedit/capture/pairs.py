"""Which photos are compared."""

from __future__ import annotations

OVERLAP = 10
"""Neighbours on either side in a sequence (COLMAP's default)."""
BLOCK = 16
"""Photos whose features are held at once: pairs are ordered by blocks."""


def exhaustive(count: int) -> list[tuple[int, int]]:
    """Every pair of `count` photos, once."""
    return _in_blocks({(i, j) for i in range(count) for j in range(i + 1, count)})


def sequential(count: int, overlap: int = OVERLAP) -> list[tuple[int, int]]:
    """Each photo with the `overlap` after it and with those 2^k after it, the last with the first.

    Powers of two reach across the orbit (COLMAP's quadratic overlap); the wrap-around closes it.
    """
    steps = {
        *range(1, overlap + 1),
        *(2**k for k in range(count.bit_length()) if 2**k <= count / 2),
    }
    ends = ((i, (i + step) % count) for i in range(count) for step in steps)
    return _in_blocks({(min(i, j), max(i, j)) for i, j in ends if i != j})


def _in_blocks(pairs: set[tuple[int, int]]) -> list[tuple[int, int]]:
    return sorted(pairs, key=lambda pair: (pair[0] // BLOCK, pair[1] // BLOCK, *pair))
