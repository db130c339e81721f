"""As rigid as possible: where nodes go, and how they turn, when some of them are held.

Sorkine and Alexa (2007) on a graph of nodes instead of a mesh. `c` nodes, `e` edges.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64

from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quaternions import turn_between

EDGES = 8
"""Nearest nodes that each is tied to."""
ROUNDS = 400
"""Most rounds of turns, then places."""
SETTLED = 1e-6
"""Largest step of a node, in the extent, after which rounds end."""
LOOSE = 1e-6
"""Weight of a node's last turn against its edges: a lone edge leaves the turn about it open."""
FLAT = 1e-6
"""Spread across, against along, below which held points lie on a line."""


def edges_of(nodes: Float64[np.ndarray, "c 3"]) -> Int64[np.ndarray, "e 2"]:
    """Pairs of nodes that are tied: the nearest, and what makes all of them hang together."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial.distance import cdist

    count = len(nodes)
    near = k_nearest(nodes, nodes, min(EDGES + 1, count))[1]
    pairs = np.stack((np.repeat(np.arange(count), near.shape[1]), near.reshape(-1)), 1)
    tree = minimum_spanning_tree(coo_matrix(cdist(nodes, nodes))).tocoo()
    pairs = np.concatenate((pairs, np.stack((tree.row, tree.col), 1)))
    pairs = np.sort(pairs, 1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0).astype(np.int64)


def fitted_turn(
    before: Float64[np.ndarray, "h 3"], after: Float64[np.ndarray, "h 3"]
) -> Float64[np.ndarray, "3 3"]:
    """The rotation that takes points nearest to others, both about their means; the smallest of
    equally good ones, as where they lie on a line or there is one."""
    start, end = before - before.mean(0), after - after.mean(0)
    along, size, _ = np.linalg.svd(start.T, full_matrices=False)
    if not len(size) or size[0] <= 0:
        return np.eye(3)
    if len(size) < 2 or size[1] < FLAT * size[0]:
        weights = start @ along[:, 0]
        ahead = weights @ end
        if np.linalg.norm(ahead) < FLAT * weights @ weights:
            return np.eye(3)
        return turn_between(along[:, 0], ahead)
    return rotations_of((end.T @ start)[None])[0]


def rotations_of(matrices: Float64[np.ndarray, "m 3 3"]) -> Float64[np.ndarray, "m 3 3"]:
    """The rotation nearest to each matrix."""
    left, _, right = np.linalg.svd(matrices)
    flip = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= np.where(flip == 0, 1, flip)[:, None]
    return left @ right


def settled(
    nodes: Float64[np.ndarray, "c 3"],
    edges: Int64[np.ndarray, "e 2"],
    held: Bool[np.ndarray, " c"],
    targets: Float64[np.ndarray, "c 3"],
) -> tuple[Float64[np.ndarray, "c 3"], Float64[np.ndarray, "c 3 3"]]:
    """Places and turns of the nodes; the rows of `targets` count for those that are held, at least
    one."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    turn = fitted_turn(nodes[held], targets[held])
    places = (nodes - nodes[held].mean(0)) @ turn.T + targets[held].mean(0)
    places[held] = targets[held]
    first, second = edges.T
    count, free = len(nodes), ~held
    ones = np.ones(len(edges))
    matrix = coo_matrix((ones, (first, second)), (count, count)).tocsc()
    matrix = matrix + matrix.T
    laplacian = coo_matrix((np.asarray(matrix.sum(1)).ravel(), (np.arange(count),) * 2)) - matrix
    laplacian = laplacian.tocsc()
    offset = nodes[first] - nodes[second]
    square = float(np.square(offset).sum()) / max(len(offset), 1)
    own = LOOSE * square or 1.0
    solver = splu(laplacian[free][:, free]) if free.any() else None
    tied = laplacian[free][:, held] @ targets[held]
    extent = max(float(np.ptp(nodes, axis=0).max()), 1e-12)
    turns = np.broadcast_to(turn, (count, 3, 3)).copy()
    for _ in range(ROUNDS):
        turns = _turns(places, offset, edges, own * turns)
        if solver is None:
            break
        pulled = 0.5 * np.einsum("eij,ej->ei", turns[first] + turns[second], offset)
        right = np.zeros((count, 3))
        np.add.at(right, first, pulled)
        np.add.at(right, second, -pulled)
        found = solver.solve(right[free] - tied)
        step = float(np.abs(found - places[free]).max())
        places[free] = found
        if step < SETTLED * extent:
            break
    return places, _turns(places, offset, edges, own * turns)


def _turns(
    places: Float64[np.ndarray, "c 3"],
    offset: Float64[np.ndarray, "e 3"],
    edges: Int64[np.ndarray, "e 2"],
    before: Float64[np.ndarray, "c 3 3"],
) -> Float64[np.ndarray, "c 3 3"]:
    """The rotation of each node that its edges have made; a trace of the one before decides what
    they leave open."""
    first, second = edges.T
    products = (places[first] - places[second])[:, :, None] * offset[:, None]
    total = before.copy()
    np.add.at(total, first, products)
    np.add.at(total, second, products)
    return rotations_of(total)
