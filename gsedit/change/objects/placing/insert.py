"""Insert the object of another scene: upright, of a fitting size, on the ground, in this light.

`n` Gaussians of the scene, `m` of the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.change.objects.placing.daylight import Daylight, dimmed, shaded, sun_of
from gsedit.change.objects.placing.landing import Ground, extent, free_point, ground_near
from gsedit.change.objects.placing.place import added, motion_of, moved, notes_of
from gsedit.change.objects.placing.placement import Placement, RelativePlace, Triple, check_target
from gsedit.change.objects.placing.stance import SOLID, Stance, size_of, stance_of
from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.framing import bounds, framing_camera, guess_up, weighted_quantile
from gsedit.scene.outcome import NEW, Outcome, check_finite, same
from gsedit.scene.quaternions import axis_rotation, turn_between
from gsedit.scene.similarity import IDENTITY
from gsedit.views.around import cameras_of
from gsedit.views.normals import visible_area
from gsedit.views.place import Place, place_of
from gsedit.views.surroundings import ROWS, Surroundings, cell_areas, cell_directions, light_at
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

LAYERS = 48
"""Layers of heights among which a ground is looked for, and cells along the longest side of the
grid in which parts are connected."""
APART, FEWEST = 2.5, 8
"""Least side of such a cell, in standard deviations of the Gaussians, which are 1.5 apart, and the
fewest cells along the longest side."""
BULK = (0.005, 0.995)
"""Ranks of heights between which those layers are: stray Gaussians are beyond."""
GROUND = 0.25
"""Least share of a scene's surface in a ground."""
THICK, STANDS = 0.4, 0.03
"""Largest share of all layers up to the top of a ground, and least share of the surface above it.
"""
FADED = 0.15
"""Share of the fullest layer's surface below which a layer is no longer of the ground."""
WIDER = 1.4
"""Least reach of a ground against that of what stands on it, level: a body is no wider than itself.
"""
LOOSE = 0.02
"""Least share of the main part's surface in another part that goes with it."""
BESIDE = 0.3
"""Largest distance of such a part from the main part's box, of its size."""


def main_object(scene: Gaussians, up: Float[Tensor, "3"]) -> Bool[Tensor, " n"]:
    """The object that a scene is about: what stands in its middle on its ground.

    Of a scene without a ground it is everything but stray Gaussians.
    """
    solid = scene.opacities > SOLID
    solid = solid if bool(solid.any()) else torch.ones_like(solid)
    above = above_ground(scene, up)
    raised = solid if above is None else solid & above
    numbers = _parts(scene, raised)
    main = _main_parts(scene, numbers, None if above is None else bounds(scene).center)
    return main if above is None else main & above


def above_ground(scene: Gaussians, up: Float[Tensor, "3"]) -> Bool[Tensor, " n"] | None:
    """Flag what is above the ground of a scene; None where it has no ground.

    A ground is a layer that holds much of the surface, and reaches farther than what is above it.
    """
    points, weights = scene.means.double(), visible_area(scene)
    heights = points @ up
    low, high = (float(weighted_quantile(heights[:, None], weights, rank)) for rank in BULK)
    step = max(high - low, 1e-12) / LAYERS
    layers = ((heights - low) / step).long().clamp(0, LAYERS - 1)
    mass = torch.zeros(LAYERS, dtype=torch.float64).index_add_(0, layers, weights)
    peak = int(mass.argmax())
    empty = (mass[peak:] < FADED * mass[peak]).nonzero()
    top = peak + int(empty[0]) if len(empty) else LAYERS
    above = heights > low + top * step
    thick = top > THICK * LAYERS or float(mass[top:].sum()) < STANDS * float(mass.sum())
    if thick or float(mass[:top].sum()) < GROUND * float(mass.sum()) or not bool(above.any()):
        return None
    level = points - heights[:, None] * up
    middle = level.median(0).values
    away = (level - middle).norm(dim=-1)[:, None]
    ground, body = (
        float(weighted_quantile(away[part], weights[part], 0.9)) for part in (~above, above)
    )
    return above if ground > WIDER * body else None


def _parts(scene: Gaussians, chosen: Bool[Tensor, " n"]) -> Int[Tensor, " n"]:
    """The number, from 1, of the connected part that each Gaussian is in; 0: none."""
    from scipy.ndimage import label

    points = scene.means[chosen].double().numpy()
    low, high = np.quantile(points, (0.001, 0.999), axis=0)
    wide = float(scene.log_scales[chosen].sort(-1).values[:, 1].median().exp())
    side = max(float((high - low).max()), 1e-9)
    cell = min(max(side / LAYERS, APART * wide), side / FEWEST)
    cells = np.floor((scene.means.double().numpy() - low) / cell).astype(np.int64) + 1
    shape = np.floor((high - low) / cell).astype(np.int64) + 3
    beyond = ((cells < 0) | (cells >= shape)).any(1)
    cells = cells.clip(0, shape - 1)
    full = np.zeros(shape, bool)
    full[tuple(cells[chosen.numpy() & ~beyond].T)] = True
    numbers = np.asarray(label(full, np.ones((3, 3, 3)))[0])  # pyright: ignore
    own = numbers[tuple(cells.T)]
    return torch.from_numpy(np.where(beyond, 0, own).astype(np.int64))


def _main_parts(
    scene: Gaussians, numbers: Int[Tensor, " n"], center: tuple[float, float, float] | None
) -> Bool[Tensor, " n"]:
    """The part with most surface, and those near it; around a center, what is far counts less."""
    weights = visible_area(scene)
    points = scene.means.double()
    if center is not None:
        away = (points - torch.tensor(center, dtype=torch.float64)).norm(dim=-1)
        weights = weights * torch.exp(-((away / away.median().clamp_min(1e-12)) ** 2))
    count = int(numbers.max()) + 1
    mass = torch.zeros(count, dtype=torch.float64).index_add_(0, numbers, weights)
    mass[0] = 0
    best = int(mass.argmax())
    if not best:
        return torch.ones_like(numbers, dtype=torch.bool)
    ours = points[numbers == best]
    low, high = ours.amin(0), ours.amax(0)
    margin = BESIDE * float((high - low).norm())
    near = ((points > low - margin) & (points < high + margin)).all(1)
    heavy = mass[numbers] >= LOOSE * mass[best]
    return (numbers > 0) & heavy & (near | (numbers == best))


STUDIO = 0.35
"""Mean light, in the range [0, 1], of the white surroundings that a lone object is taken to have
been captured in."""
TRUSTED = 0.5
"""Power of the ratio of two lights that an object takes: colors of surroundings are of things too,
not of light only."""
BRIGHTER, TINTED = (0.6, 1.25), (0.9, 1.1)
"""Ranges of the linear factor of brightness, and of a channel against the others."""
BODY = 0.6
"""Distance, of its height, within which nothing is seen from an object's middle."""
KNOWN = 0.15
"""Least share of what is above the horizon that must be seen for its light to be known."""


def balanced(
    body: Gaussians,
    stance: Stance,
    scene: Gaussians,
    up: Float[Tensor, "3"],
    cameras: Sequence[Camera] = (),
) -> Gaussians:
    """An object in the brightness and color of the light from above at its place.

    It is taken to come from a studio. Where little above the horizon is seen, it stays as it is.
    """
    middle = stance.foot + stance.height / 2 * stance.up
    near = BODY * stance.height
    here = light_at(scene, middle, near, up, cameras=cameras)
    ours = None if here.studio else _from_above(here, up)
    if ours is None:
        return body
    theirs = torch.full((3,), STUDIO, dtype=torch.float64)
    return dimmed(body, gain(ours, theirs).expand(len(body), 3))


def gain(ours: Float[Tensor, "3"], theirs: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """Linear factors a channel that take an object from one light to another, bounded."""
    weights = torch.from_numpy(LUMINANCE)
    bright = ((ours @ weights) / (theirs @ weights)).clamp_min(1e-3) ** TRUSTED
    tint = (ours / (ours @ weights)) / (theirs / (theirs @ weights))
    tint = (tint.clamp_min(1e-3) ** TRUSTED).clamp(*TINTED)
    return bright.clamp(*BRIGHTER) * tint


def _from_above(here: Surroundings, up: Float[Tensor, "3"]) -> Float[Tensor, "3"] | None:
    """Mean light on a level place from what was seen above the horizon; None where little was."""
    rise = (cell_directions(ROWS).double() @ up).clamp_min(0)
    area = cell_areas(ROWS).double() * rise
    weight = area * here.seen.double()
    if float(weight.sum()) < KNOWN * float(area.sum()):
        return None
    return (here.radiance.double() * weight[..., None]).sum((0, 1)) / weight.sum()


SHARE = 0.3
"""Size of an inserted object, of the height of the pictures where the cameras look at."""
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
    *,
    height: float | int | None = None,
    turn: float | int = 0.0,
    up: Float[Tensor, "3"] | None = None,
) -> Outcome:
    """The scene with the main object of another one, which stands on a surface and is lit as here.

    `at` is a world point, a place beside something, or None: a free place near what the cameras
    look at. Its `height` is in world units; without one its size is fitted: to what it stands
    beside, or to the pictures. `turn` is in degrees about the
    upward direction, and `up` the other scene's; without it that is guessed, and the front of the
    object turned to the cameras. SH are brought to the scene's degree.
    Raises UsageError for values out of range, and for scenes without Gaussians.
    """
    _check(scene, other, at, height, turn)
    scene, other = scene.detach(), other.detach()
    seen_from = cameras_of(scene, cameras)
    around = place_of(scene, seen_from)
    theirs = guess_up(other) if up is None else torch.nn.functional.normalize(up.double(), dim=0)
    inside = main_object(other, theirs)
    surroundings = other[~inside]
    own = stance_of(other[inside], surroundings, theirs)
    factor, note = _factor(scene, other[inside], own, at, height, around, seen_from)
    body, stance = _upright(other[inside], own, factor, around, turned=up is None)
    target, ground = at, Ground(scene, around, seen_from)
    if at is None:
        reach = max(NEAR * around.distance, 2 * stance.height)
        middle = ground_near(ground, around.distance / 2)
        free = free_point(body, stance, middle, reach, ground)
        target = tuple((middle if free is None else free).tolist())
    beside = scene[at.of] if isinstance(at, RelativePlace) and at.of is not None else None
    placement = Placement(turn=turn, to=target)
    motion = motion_of(body, stance, placement, beside, ground)
    there = moved(body, motion.similarity).with_degree(scene.degree)
    there = balanced(there, motion.stance, scene, around.up, seen_from)
    light = Daylight(around, sun_of(scene, motion.stance))
    base = shaded(same(scene), there, motion.stance, light)
    rows = torch.full((len(there),), NEW)
    told = notes_of(replace(motion, rise=0.0), there, ground)
    return added(base, there, rows, (note, *told))


def _check(
    scene: Gaussians,
    other: Gaussians,
    at: Triple | RelativePlace | None,
    height: float | int | None,
    turn: float | int,
) -> None:
    if not len(scene) or not len(other):
        raise UsageError("a scene without Gaussians: insert an object into a scene that has some")
    check_finite(scene)
    check_finite(other)
    check_target(at, len(scene))
    if isinstance(at, RelativePlace) and at.of is None:
        raise UsageError("beside what: give the Gaussians of what it is to be inserted beside")
    if not isfinite(turn):
        raise UsageError("a turn is a finite number of degrees: give one")
    if height is not None and not (isfinite(height) and height > 0):
        raise UsageError(f"height {height:g}: give a number above 0, or none to have it fitted")


def _factor(
    scene: Gaussians,
    body: Gaussians,
    stance: Stance,
    at: Triple | RelativePlace | None,
    height: float | int | None,
    place: Place,
    cameras: Sequence[Camera],
) -> tuple[float, str]:
    """Factor of an object's lengths, and a remark on its size."""
    own = size_of(body)
    if height is not None:
        factor = height / stance.height
    elif isinstance(at, RelativePlace) and at.of is not None and at.side != "on":
        like = scene[at.of]
        low, high = extent(like.means, place.up)
        factor = min(size_of(like) / own, (high - low) / stance.height)
    else:
        factor = SHARE * _picture(place, cameras) / own
    high = factor * stance.height
    note = f"inserted {high:.3g} world units high, {factor:.3g} times its own size"
    return factor, note if height is not None else f"{note}, which is fitted: a height says another"


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
    sized = replace(stance, up=place.up, height=factor * stance.height, stands=False)
    return moved(body, similarity), sized
