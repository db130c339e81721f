"""Bend a part of a scene by handles: what is between them follows as rigidly as possible.

Control nodes are spread evenly over the part. They settle as rigidly as possible (Sorkine and Alexa
2007, on a graph instead of a mesh); a point follows the nodes near it, by weights that fall
smoothly to 0 (embedded deformation, Sumner et al. 2007, with weights whose gradient is known).
`n` Gaussians or points, `m` of them moved; `c` nodes, `e` edges, `q` nodes near a point; world
units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.outcome import Outcome, check_finite, same
from gsedit.scene.quaternions import axis_rotation, quaternions_of, rotate_sh_each, turn_between
from gsedit.scene.quaternions import rotations as rotations_of_quaternions
from rasterizer.scene import Gaussians

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


Point = tuple[float | int, float | int, float | int]
STILL = 1e-9
"""Motion, in the extent, and change of shape below which a Gaussian keeps its bits."""
ARM = 0.02
"""Distance of the places that turn with a handle without a radius, in the extent."""
FARTHEST = 0.5
"""Distance of a handle from what is bent, in its extent, beyond which it is a mistake."""
STRETCHED = 3.0
"""Largest stretch that no remark is made on."""


@dataclass(frozen=True)
class Handle:
    """A place that is taken somewhere; with the same target it is held."""

    point: Point
    """Place before, world units."""
    target: Point
    radius: float | int = 0.0
    """Distance within which all moves with it like a solid; 0: only the place itself is given."""
    turn: Point | None = None
    """Rotation about the point as an axis times degrees; None: none of what is within the radius,
    any of a place."""


@torch.no_grad()
def bend(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    handles: Sequence[Handle],
    cage: Bool[Tensor, " n"] | None = None,
) -> Outcome:
    """The scene with the Gaussians inside bent so that each handle's point is at its target.

    Only Gaussians in the cage (None: all inside) move; those inside that are out of it stay, and
    what is next to them. Centers go with a smooth map, covariances with its Jacobian, and SH turn.
    Raises UsageError for no handles, ones that contradict or are far away, and a map that folds.
    """
    check_finite(scene)
    rows, moving = _rows(inside, cage)
    points = scene.means[rows].double().numpy()
    own_size = float(scene.log_scales[rows].amax().exp())  # of a part that is one place
    extent = max(float(np.ptp(points, axis=0).max()), own_size, 1e-12)
    _check(handles, points, extent)
    motion = _motion(points, moving.numpy(), handles, extent)
    own = rows[moving]
    places, jacobians = motion.applied(points[moving.numpy()])
    _refuse_folds(jacobians, handles)
    far = np.abs(places - points[moving.numpy()]).max(1) > STILL * extent
    other = far | (np.abs(jacobians - np.eye(3)).max((1, 2)) > STILL)
    chosen = torch.from_numpy(other)
    if not bool(chosen.any()):
        return same(scene)
    bent = carried(scene[own[chosen]], places[other], jacobians[other])
    changed = torch.zeros(len(scene), dtype=torch.bool)
    changed[own[chosen]] = True
    after = scene.detach().map(torch.clone)
    for name, values in vars(bent).items():
        getattr(after, name)[own[chosen]] = values.to(getattr(after, name))
    return Outcome(after, torch.arange(len(scene)), changed, _notes(jacobians[other]))


def carried(
    part: Gaussians, places: Float64[np.ndarray, "m 3"], jacobians: Float64[np.ndarray, "m 3 3"]
) -> Gaussians:
    """Gaussians at new places, their covariances J S J^T and their SH turned as J turns."""
    axes = rotations_of_quaternions(part.quats.double().numpy())
    stretched = jacobians @ axes * part.log_scales.double().exp().numpy()[:, None]
    # singular values of J R diag(s) keep the digits of a needle that those of J S J^T would lose
    left, sizes, _ = np.linalg.svd(stretched)
    left[:, :, 2] *= np.sign(np.linalg.det(left))[:, None]
    quats = quaternions_of(left)
    with np.errstate(divide="ignore"):
        log_scales = np.log(sizes)
    sh = rotate_sh_each(part.sh.float().numpy(), rotations_of(jacobians))
    fields = (places, quats, log_scales)
    means, quats, log_scales = (torch.from_numpy(each).to(part.means) for each in fields)
    return replace(
        part, means=means, quats=quats, log_scales=log_scales, sh=torch.from_numpy(sh).to(part.sh)
    )


def _rows(inside: Bool[Tensor, " n"], cage: Bool[Tensor, " n"] | None) -> tuple[Tensor, Tensor]:
    """Rows inside, and which of them may move."""
    rows = inside.nonzero().squeeze(-1)
    moving = torch.ones(len(rows), dtype=torch.bool) if cage is None else cage[rows]
    if not len(rows):
        raise UsageError("no Gaussian is inside: name a region that holds what should be bent")
    if not bool(moving.any()):
        raise UsageError("the cage holds nothing of the region: make it larger, or leave it out")
    return rows, moving


def _check(handles: Sequence[Handle], points: Float64[np.ndarray, "n 3"], extent: float) -> None:
    """Refuse handles that say nothing, contradict or have nothing near them."""
    if not handles:
        raise UsageError("there is no handle: give a point and where it goes")
    for number, handle in enumerate(handles, 1):
        values = (*handle.point, *handle.target, *(handle.turn or ()), handle.radius)
        if not all(map(isfinite, values)) or handle.radius < 0:
            raise UsageError(f"handle {number} is not of finite numbers and a radius of 0 or more")
        near = float(k_nearest(points, np.array([handle.point]), 1)[0][0, 0])
        if near > FARTHEST * extent + handle.radius:
            raise UsageError(
                f"handle {number} is {near:.3g} from what is inside, which is {extent:.3g} wide: "
                "put it on the object, or make the region larger"
            )
        for other, earlier in enumerate(handles[: number - 1], 1):
            if earlier.point == handle.point and earlier.target != handle.target:
                raise UsageError(
                    f"handles {other} and {number} take the same point to two places: leave one out"
                )


def _motion(
    points: Float64[np.ndarray, "n 3"],
    moving: Bool[np.ndarray, " n"],
    handles: Sequence[Handle],
    extent: float,
) -> Motion:
    """Nodes on the points and the handles, and where they settle."""
    held, targets = _held_places(handles, extent)
    nodes = np.concatenate((held, points[spread(points, held)]))
    reach = reach_of(points, nodes)
    goals, fixed = nodes.copy(), np.zeros(len(nodes), bool)
    goals[: len(held)], fixed[: len(held)] = targets, True
    for handle in handles:
        start = np.array(handle.point)
        near = (np.linalg.norm(nodes - start, axis=1) <= handle.radius) & ~fixed
        goals[near] = (nodes[near] - start) @ _turn(handle).T + handle.target
        fixed |= near
    if not moving.all():
        away = k_nearest(points[~moving], nodes, 1)[0][:, 0]
        fixed |= (away <= reach) & (np.arange(len(nodes)) >= len(held))
    places, turns = settled(nodes, edges_of(nodes), fixed, goals)
    return Motion(nodes, places, turns, reach)


def _held_places(
    handles: Sequence[Handle], extent: float
) -> tuple[Float64[np.ndarray, "h 3"], Float64[np.ndarray, "h 3"]]:
    """Places that handles give, without repetitions, and their targets; of one that turns, three
    more around it."""
    places: dict[Point, Float64[np.ndarray, 3]] = {}
    for handle in handles:
        start, end = np.array(handle.point, np.float64), np.array(handle.target, np.float64)
        places.setdefault(handle.point, end)
        if handle.turn is not None or handle.radius > 0:
            arm = handle.radius or ARM * extent
            for axis in arm * np.eye(3):
                x, y, z = (start + axis).tolist()
                places.setdefault((x, y, z), end + _turn(handle) @ axis)
    return np.array(list(places)), np.array(list(places.values()))


def _turn(handle: Handle) -> Float64[np.ndarray, "3 3"]:
    turn = np.array(handle.turn or (0.0, 0.0, 0.0))
    angle = float(np.linalg.norm(turn))
    return axis_rotation(turn, angle) if angle > 0 else np.eye(3)


def _refuse_folds(jacobians: Float64[np.ndarray, "m 3 3"], handles: Sequence[Handle]) -> None:
    """Raise UsageError where the map turns a neighborhood inside out."""
    folded = int((np.linalg.det(jacobians) <= 0).sum())
    if not folded:
        return
    moves = [np.linalg.norm(np.subtract(each.target, each.point)) for each in handles]
    worst = int(np.argmax(moves)) + 1
    raise UsageError(
        f"the handles fold space at {folded:,} of {len(jacobians):,} Gaussians: move handle "
        f"{worst} less far, in two bends, or hold fewer places near it"
    )


def _notes(jacobians: Float64[np.ndarray, "m 3 3"]) -> tuple[str, ...]:
    sizes = np.linalg.svd(jacobians, compute_uv=False)
    notes = [f"{len(jacobians):,} Gaussians were moved"]
    if (most := float(sizes.max())) > STRETCHED:
        notes.append(f"something is stretched {most:.1f} times: hold it with more handles")
    return tuple(notes)
