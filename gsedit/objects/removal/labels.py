"""Labels of pixels, one shift each to copy by, that leave the least visible seams.

The optimum of a Markov random field, nearly, by alpha expansion (Boykov, Veksler and Zabih 2001);
each move is a minimal cut. `p` pixels of the hole, `e` pairs of neighbors, `k`
shifts.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

SWEEPS = 3
"""Times that every shift is offered to all pixels."""
UNIT = 1000
"""Steps of a cost of 1: cuts are found in integers."""
NEVER = 50.0
"""Cost of a shift that leads to nothing known: more than any way around it."""


def best_labels(
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Int64[np.ndarray, " p"]:
    """The label of each pixel with the least sum of its cost and of the seams to its neighbors.

    `single` is the cost of each label, `values` the color that it gives a pixel. Neighbors of two
    labels cost what these give differently at both pixels.
    """
    labels = single.argmin(0)
    energy = _energy(labels, single, values, pairs)
    for _ in range(SWEEPS):
        before = energy
        for label in range(len(single)):
            moved = _expanded(labels, label, single, values, pairs)
            after = _energy(moved, single, values, pairs)
            if after < energy:
                labels, energy = moved, after
        if energy >= before:
            break
    return labels


def _seams(
    a: Int64[np.ndarray, " e"],
    b: Int64[np.ndarray, " e"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Float[np.ndarray, " e"]:
    """Cost of label `a` at the first of each pair and `b` at the second."""
    first, second = pairs.T
    at = np.linalg.norm(values[a, first] - values[b, first], axis=-1)
    return at + np.linalg.norm(values[a, second] - values[b, second], axis=-1)


def _energy(
    labels: Int64[np.ndarray, " p"],
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> float:
    seams = _seams(labels[pairs[:, 0]], labels[pairs[:, 1]], values, pairs)
    return float(single[labels, np.arange(len(labels))].sum() + seams.sum())


def _expanded(
    labels: Int64[np.ndarray, " p"],
    label: int,
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Int64[np.ndarray, " p"]:
    """The best labels of those that keep theirs or take `label`: a minimal cut."""
    count = len(labels)
    first, second = pairs.T
    new = np.full(len(pairs), label)
    keep = _seams(labels[first], labels[second], values, pairs)
    one = _seams(labels[first], new, values, pairs)  # the second takes the label
    other = _seams(new, labels[second], values, pairs)
    stay, take = single[labels, np.arange(count)].copy(), single[label].copy()
    # E(x, y) with x, y = 1 for taking: keep + (other - keep) x + (0 - other) y + rest (1 - x) y
    np.add.at(take, first, other - keep)
    np.add.at(take, second, -other)
    rest = np.maximum(one + other - keep, 0)
    low = np.minimum(stay, take)
    to_take, to_stay = take - low, stay - low
    source, sink = count, count + 1
    nodes = np.arange(count)
    rows = np.concatenate((np.full(count, source), nodes, first))
    columns = np.concatenate((nodes, np.full(count, sink), second))
    # source side stays (x = 0): cut source->p is paid by taking; p->sink by staying
    weights = np.concatenate((to_take, to_stay, rest))
    whole = np.round(weights * UNIT).astype(np.int32)
    graph = coo_matrix((whole, (rows, columns)), (count + 2, count + 2)).tocsr()
    flow = maximum_flow(graph, source, sink).flow
    residual = graph - flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, source, return_predecessors=False)
    stays = np.zeros(count + 2, bool)
    stays[reached] = True
    return np.where(stays[:count], labels, label)
