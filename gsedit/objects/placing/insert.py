"""Insert the object of another scene: upright, of a fitting size, on the ground, in this light.

`n` Gaussians of the scene, `m` of the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.around import cameras_of
from gsedit.cameras.place import Place, place_of
from gsedit.errors import UsageError
from gsedit.objects.outcome import NEW, Outcome, check_finite, same
from gsedit.objects.placing.arrival import main_object
from gsedit.objects.placing.balance import balanced
from gsedit.objects.placing.daylight import daylight, shaded
from gsedit.objects.placing.free import Ground, free_point
from gsedit.objects.placing.landing import extent, ground_near
from gsedit.objects.placing.motion import motion_of, moved
from gsedit.objects.placing.place import added, notes_of
from gsedit.objects.placing.placement import Placement, RelativePlace, Triple, check_target
from gsedit.objects.placing.stance import Stance, size_of, stance_of
from gsedit.objects.placing.sun import sun_of
from gsedit.scene.framing import framing_camera, guess_up
from gsedit.scene.quaternions import axis_rotation, turn_between
from gsedit.scene.similarity import IDENTITY
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

SHARE = 0.3
"""Size of an inserted object, of the height of the pictures where the cameras look at."""
ODD = (0.02, 20.0)
"""Size of an object, of the pictures' height, beyond which an asked one is remarked on."""
FIELD = 0.8
"""Height of such a picture, of the cameras' distance, where a scene has no pinhole cameras."""
NEAR = 1.2
"""Distance from what the cameras look at within which a free place is searched, of theirs."""


@torch.no_grad()
def insert(
    scene: Gaussians,
    other: Gaussians,
    at: Triple | RelativePlace | None = None,
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
    *,
    height: float | int | None = None,
    scale: float | int | None = None,
    turn: float | int = 0.0,
    up: Float[Tensor, "3"] | None = None,
) -> Outcome:
    """The scene with the main object of another one, which stands on a surface and is lit as here.

    `at` is a world point, a place beside something, or None: a free place near what the cameras
    look at. Its `height` is in world units; or `scale` is a factor of its own lengths; with neither
    its size is fitted: to what it stands beside, or to the pictures. `turn` is in degrees about the
    upward direction, and `up` the other scene's; without it that is guessed, and the front of the
    object turned to the cameras. SH are brought to the scene's degree.
    Raises UsageError for values out of range, and for scenes without Gaussians.
    """
    _check(scene, other, at, height, scale, turn)
    scene, other = scene.detach(), other.detach()
    seen_from = cameras_of(scene, cameras, execution=execution)
    around = place_of(scene, seen_from)
    theirs = guess_up(other) if up is None else torch.nn.functional.normalize(up.double(), dim=0)
    inside = main_object(other, theirs)
    surroundings = other[~inside]
    own = stance_of(other[inside], surroundings, theirs, execution)
    factor, note = _factor(scene, other[inside], own, at, height, scale, around, seen_from)
    body, stance = _upright(other[inside], own, factor, around, turned=up is None)
    target, ground = at, Ground(scene, around, seen_from, execution)
    if at is None:
        reach = max(NEAR * around.distance, 2 * stance.height)
        middle = ground_near(ground, around.distance / 2)
        free = free_point(body, stance, middle, reach, ground)
        target = tuple((middle if free is None else free).tolist())
    beside = scene[at.of] if isinstance(at, RelativePlace) and at.of is not None else None
    placement = Placement(turn=turn, to=target)
    motion = motion_of(body, stance, placement, beside, ground)
    there = with_degree(moved(body, motion.similarity), scene.degree)
    there = balanced(there, motion.stance, scene, around.up, seen_from, execution)
    light = daylight(around, sun_of(scene, motion.stance, execution))
    base = shaded(same(scene), there, motion.stance, light, execution)
    rows = torch.full((len(there),), NEW)
    told = notes_of(replace(motion, rise=0.0), there, ground)
    return added(base, there, rows, (note, *told))


def _check(
    scene: Gaussians,
    other: Gaussians,
    at: Triple | RelativePlace | None,
    height: float | int | None,
    scale: float | int | None,
    turn: float | int,
) -> None:
    if not len(scene) or not len(other):
        raise UsageError("a scene without Gaussians: insert an object into a scene that has some")
    check_finite(scene)
    check_finite(other)
    check_target(at, len(scene))
    if isinstance(at, RelativePlace) and at.of is None:
        raise UsageError("beside what: give the Gaussians of what it is to be inserted beside")
    if height is not None and scale is not None:
        raise UsageError("a height and a scale contradict: give one of them")
    if not isfinite(turn):
        raise UsageError("a turn is a finite number of degrees: give one")
    for name, value in (("height", height), ("scale", scale)):
        if value is not None and not (isfinite(value) and value > 0):
            raise UsageError(f"{name} {value:g}: give a number above 0, or none to have it fitted")


def _factor(
    scene: Gaussians,
    body: Gaussians,
    stance: Stance,
    at: Triple | RelativePlace | None,
    height: float | int | None,
    scale: float | int | None,
    place: Place,
    cameras: Sequence[Camera],
) -> tuple[float, str]:
    """Factor of an object's lengths, and a remark on its size."""
    own = size_of(body)
    if height is not None:
        factor = height / stance.height
    elif scale is not None:
        factor = scale
    elif isinstance(at, RelativePlace) and at.of is not None and at.side != "on":
        like = scene[at.of]
        low, high = extent(like.means, place.up)
        factor = min(size_of(like) / own, (high - low) / stance.height)
    else:
        factor = SHARE * _picture(place, cameras) / own
    high = factor * stance.height
    note = f"inserted {high:.3g} world units high, {factor:.3g} times its own size"
    if height is None and scale is None:
        return factor, f"{note}, which is fitted: a height or a scale says another"
    share = factor * own / _picture(place, cameras)
    if not ODD[0] < share < ODD[1]:
        note += (
            f": {share:.2g} of a picture's height, hardly what is meant; without it, it is fitted"
        )
    return factor, note


def _picture(place: Place, cameras: Sequence[Camera]) -> float:
    """The height of the pictures, world units, at the distance of what the cameras look at."""
    fields = [c.height / c.fy for c in cameras if c.model == "pinhole"]
    return place.distance * (sorted(fields)[len(fields) // 2] if fields else FIELD)


def _upright(
    body: Gaussians, stance: Stance, factor: float, place: Place, *, turned: bool
) -> tuple[Gaussians, Stance]:
    """An object of its new size, upright in a place by the smallest turn; then, where it is to be
    turned, with its front to where the place is seen from.

    Its front is what `framing_camera` shows of it.
    """
    turn = upright = turn_between(stance.up.numpy(), place.up.numpy())
    back = framing_camera(body, up=stance.up).forward.numpy() @ upright.T
    up, front = place.up.numpy(), place.front.numpy()
    level = back @ up * up - back
    angle = np.degrees(np.arctan2(np.cross(level, front) @ up, level @ front))
    if turned:
        turn = axis_rotation(up, float(angle)) @ upright
    similarity = replace(IDENTITY, turn=turn, scale=factor).about(stance.foot.numpy())
    sized = replace(
        stance, up=place.up, height=factor * stance.height, gap=factor * stance.gap, stands=False
    )
    return moved(body, similarity), sized


def with_degree(body: Gaussians, degree: int) -> Gaussians:
    """Gaussians with SH of a degree: bands above it are left out, missing ones are 0."""
    count = (degree + 1) ** 2
    sh = body.sh[:, :count]
    missing = sh.new_zeros(len(body), count - sh.shape[1], 3)
    return replace(body, sh=torch.cat((sh, missing), 1))
