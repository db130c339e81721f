"""Control nodes of a bend: some of its points, spread evenly, and the map that they carry.

`n` points, `c` nodes, `q` nodes near a point; world units, float64. A node is moved and turned; a
point follows the nodes near it, by weights that fall smoothly to 0 (embedded deformation, Sumner
et al. 2007, with weights whose gradient is known).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from gsedit.scene.neighbors import k_nearest

NODES = 400
"""Nodes that are spread over what is bent."""
SPREAD_OVER = 40_000
"""Points that the nodes are chosen among."""
REACH = 2.0
"""Distance at which a node's weight ends, in the largest distance of a point from its nearest."""
NEAR = 32
"""Most nodes that move one point: as many fit into their reach if nodes are one spacing apart."""
AT_ONCE = 1 << 13
"""Points whose Jacobians are computed at once: 32 nodes each, 19 MB."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Places of nodes before and after, and their turns."""

    before: Float64[np.ndarray, "c 3"]
    after: Float64[np.ndarray, "c 3"]
    turns: Float64[np.ndarray, "c 3 3"]
    reach: float
    """Distance at which their weights end."""

    def applied(
        self, points: Float64[np.ndarray, "n 3"]
    ) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 3"]]:
        """Points moved, and the Jacobians of the map there."""
        parts = [self._applied(points[i : i + AT_ONCE]) for i in range(0, len(points), AT_ONCE)]
        places, jacobians = zip(*parts)
        return np.concatenate(places), np.concatenate(jacobians)

    def _applied(
        self, points: Float64[np.ndarray, "n 3"]
    ) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 3"]]:
        distance, rows = k_nearest(self.before, points, min(NEAR, len(self.before)))
        offset = points[:, None] - self.before[rows]
        weight, slope = self._weights(distance, offset)
        turns = self.turns[rows]
        moved = np.einsum("nqij,nqj->nqi", turns, offset) + self.after[rows]
        places = np.einsum("nq,nqi->ni", weight, moved)
        turned = np.einsum("nq,nqij->nij", weight, turns)
        # slopes sum to 0: against the place itself they lose no digits
        return places, turned + np.einsum("nqi,nqj->nij", moved - places[:, None], slope)

    def _weights(
        self, distance: Float64[np.ndarray, "n q"], offset: Float64[np.ndarray, "n q 3"]
    ) -> tuple[Float64[np.ndarray, "n q"], Float64[np.ndarray, "n q 3"]]:
        """Weights (1 - (d / reach)^2)^3, normalized, and their gradients."""
        within = np.clip(1 - np.square(distance / self.reach), 0, None)
        raw = within**3
        slope = (-6 / self.reach**2) * np.square(within)[..., None] * offset
        total = raw.sum(1, keepdims=True)
        alone = total[:, 0] < 1e-9  # beyond all reach: moves with the nearest
        raw[alone], slope[alone], total[alone] = 0, 0, 1
        raw[alone, 0] = 1
        weight = raw / total
        return weight, (slope - weight[..., None] * slope.sum(1, keepdims=True)) / total[..., None]


def spread(
    points: Float64[np.ndarray, "n 3"], first: Float64[np.ndarray, "h 3"]
) -> Int64[np.ndarray, " c"]:
    """Rows of at most NODES points, each as far as can be from those before it and from `first`."""
    rows = np.unique(
        np.linspace(0, len(points) - 1, min(len(points), SPREAD_OVER)).astype(np.int64)
    )
    among = points[rows]
    away = np.full(len(among), np.inf)
    for place in first:
        away = np.minimum(away, np.square(among - place).sum(1))
    chosen = []
    for _ in range(min(NODES, len(among))):
        farthest = int(away.argmax())
        if away[farthest] <= 0:
            break  # all that is left lies on a node
        chosen.append(rows[farthest])
        away = np.minimum(away, np.square(among - among[farthest]).sum(1))
    return np.array(chosen, np.int64)


def reach_of(points: Float64[np.ndarray, "n 3"], nodes: Float64[np.ndarray, "c 3"]) -> float:
    """Distance at which weights end, so that each point is near some node."""
    farthest = float(k_nearest(nodes, points, 1)[0].max(initial=0.0))
    return REACH * max(farthest, 1e-9 * max(float(np.ptp(points, axis=0).max(initial=0.0)), 1e-9))
