"""Values inside a hole from gradients and the values around it (Poisson's equation).

`h w` pixels, `c` channels.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu

ANCHOR = 1e-6
"""Weight of what a pixel has, against one difference: decides where nothing around is known."""


def pixel_pairs(
    hole: Bool[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"]
) -> Int64[np.ndarray, "e 2"]:
    """Flat indices of neighbors, at least one of them in the hole and the other there or known."""
    flat = np.arange(hole.size).reshape(hole.shape)
    usable = hole | known
    found = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        at = usable[a] & usable[b] & (hole[a] | hole[b])
        found.append(np.stack((flat[a][at], flat[b][at]), 1))
    return np.concatenate(found)


def solve_membrane(
    values: Float[np.ndarray, "h w c"],
    hole: Bool[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    steps: tuple[Int64[np.ndarray, "e 2"], Float[np.ndarray, "e c"]] | None = None,
) -> Float[np.ndarray, "h w c"]:
    """Values with a hole filled so that neighbors differ by `steps` (second less first of a pair).

    Without steps they differ as little as they can. The rest keeps its values; a hole that nothing
    known touches keeps those that it has.
    """
    if not hole.any():
        return values
    if steps is None:
        pairs = pixel_pairs(hole, known)
        steps = pairs, np.zeros((len(pairs), values.shape[-1]))
    pairs, differences = steps
    count = int(hole.sum())
    number = np.full(hole.size, -1)
    number[hole.reshape(-1)] = np.arange(count)
    flat = values.reshape(hole.size, -1).astype(np.float64)
    rows, entries, right = [], [], []
    for sign, near in ((1, 1), (-1, 0)):  # which of the pair is given by its neighbor
        inside = number[pairs[:, near]]
        rows.append(inside)
        entries.append(number[pairs[:, 1 - near]])
        given = np.where((entries[-1] < 0)[:, None], flat[pairs[:, 1 - near]], 0)
        right.append(sign * differences + given)
    row, column, target = (np.concatenate(each) for each in (rows, entries, right))
    target, column, row = target[row >= 0], column[row >= 0], row[row >= 0]
    degree = np.bincount(row, minlength=count) + ANCHOR
    both = column >= 0
    links = csr_matrix((np.ones(both.sum()), (row[both], column[both])), (count, count))
    b = ANCHOR * flat[hole.reshape(-1)]
    np.add.at(b, row, target)
    solved = splu((diags(degree) - links).tocsc()).solve(b)
    out = flat.copy()
    out[hole.reshape(-1)] = solved
    return out.reshape(values.shape)
