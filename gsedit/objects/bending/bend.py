"""Bend a part of a scene by handles: what is between them follows as rigidly as possible.

`n` Gaussians, `m` of them moved; world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.objects.bending.nodes import Motion, reach_of, spread
from gsedit.objects.bending.rigid import edges_of, rotations_of, settled
from gsedit.objects.outcome import Outcome, check_finite, same
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.quaternions import axis_rotation, rotate_sh_each
from gsedit.scene.quaternions import rotations as rotations_of_quaternions
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

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
    execution: Execution = AUTO,
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
    from scipy.spatial.transform import Rotation

    quats = Rotation.from_matrix(left).as_quat()[:, [3, 0, 1, 2]]
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
