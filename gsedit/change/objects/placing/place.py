"""Move, scale, turn or copy an object of a scene: it stands on what is there, and is lit there.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.objects.placing.daylight import Daylight, relit_elsewhere, shaded, sun_of
from gsedit.change.objects.placing.landing import (
    Ground,
    Landing,
    carried,
    directions,
    land,
    point_beside,
)
from gsedit.change.objects.placing.placement import (
    Placement,
    RelativePlace,
    Triple,
    check_placement,
)
from gsedit.change.objects.placing.stance import STEP, Stance, middle_of, size_of, stance_of
from gsedit.change.objects.removal.belongings import tidied
from gsedit.change.objects.removal.remove import remove
from gsedit.scene.outcome import NEW, Outcome, check_finite, same
from gsedit.scene.quaternions import axis_rotation, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.views.around import cameras_of
from gsedit.views.normals import estimate_normals
from gsedit.views.place import place_of
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians, concatenate

CLIMB = 0.5
"""Height above where an object stood, of its own, up to which a surface may carry it elsewhere."""
LEANS = (3.0, 20.0)
"""Degrees between two surfaces from which an object leans with the new one, and beyond which it
stays upright."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A way from one stance to another."""

    similarity: Similarity
    stance: Stance
    """How the object stands afterwards."""
    landing: Landing | None
    """The surface that it was set on; None where it kept its height or its place."""
    rise: float = 0.0
    """Height of that surface over the one that it stood on, world units."""
    way: float = 0.0
    """How far its foot moves, world units."""
    stopped: float = 0.0
    """Way down that was asked for beyond the surface that it rests on, world units."""


def moved(body: Gaussians, similarity: Similarity) -> Gaussians:
    """An object after a similarity: positions, covariances and SH exactly."""
    return gaussians_of(similarity.table(table_of(body)))


def motion_of(
    body: Gaussians, stance: Stance, placement: Placement, other: Gaussians | None, ground: Ground
) -> Motion:
    """The way to where a placement puts an object in a scene; `other` is what it is placed beside.

    What stands on a surface goes down no farther than to it.
    """
    grown = _grown(stance, placement)
    sized = moved(body, grown)
    tall = replace(stance, height=placement.scale * stance.height)
    unit = tall.height if placement.unit is None else placement.unit
    right, back, rise = (unit * each for each in placement.offset)
    target, landing, risen = stance.foot, None, 0.0
    if placement.moves:
        target, ceiling = _asked(sized, tall, placement.to, other, ground)
        way = directions(ground.place)
        target = target + right * way["right"] + back * way["behind"]
        onto = other if _on_top(placement.to) and other is not None else ground.scene
        there = moved(sized, _shift(target - stance.foot))
        landing = land(there, target, tall, onto, ceiling)
        risen = float((landing.point - stance.foot) @ tall.up)
        target = landing.point
    asked, rise = rise, _no_deeper(rise, sized, tall, target, landing, ground)
    lean = _lean(stance, landing).about(stance.foot.numpy())
    way_there = _shift(target + rise * tall.up - stance.foot)
    tall = replace(
        tall,
        foot=target + rise * tall.up,
        up=torch.from_numpy(lean.turn) @ tall.up,
        stands=not rise and (stance.stands if landing is None else landing.found),
    )
    far = float((tall.foot - stance.foot).norm())
    return Motion(way_there.after(lean).after(grown), tall, landing, risen, far, rise - asked)


def _no_deeper(
    rise: float,
    body: Gaussians,
    stance: Stance,
    target: Float[Tensor, "3"],
    landing: Landing | None,
    ground: Ground,
) -> float:
    """A vertical shift, clamped so that the object does not sink below its surface."""
    if rise >= 0 or stance.stands or (landing is not None and landing.found):
        return max(rise, 0.0)
    ceiling = float(target @ stance.up)
    under = land(body, target, stance, ground.scene, ceiling)
    return max(rise, float((under.point - target) @ stance.up)) if under.found else rise


def _grown(stance: Stance, placement: Placement) -> Similarity:
    turn = axis_rotation(stance.up.numpy(), float(placement.turn))
    return Similarity(turn, float(placement.scale), np.zeros(3)).about(stance.foot.numpy())


def _shift(way: Float[Tensor, "3"]) -> Similarity:
    return replace(IDENTITY, translation=way.double().numpy())


def _on_top(to: Triple | RelativePlace | None) -> bool:
    return isinstance(to, RelativePlace) and to.side == "on"


def _asked(
    body: Gaussians,
    stance: Stance,
    to: Triple | RelativePlace | None,
    other: Gaussians | None,
    ground: Ground,
) -> tuple[Float[Tensor, "3"], float]:
    """The point that is asked for, and the height up to which a surface there may carry."""
    climb = CLIMB * stance.height
    if to is None:
        return stance.foot, float(stance.foot @ stance.up) + climb
    if isinstance(to, RelativePlace):
        beside = body if other is None else other
        point = point_beside(body, stance, beside, to, ground)
    else:
        point = torch.tensor(to, dtype=torch.float64)
    if _on_top(to) or not isinstance(to, RelativePlace):
        climb = STEP * stance.height
    return point, float(point @ stance.up) + climb


def _lean(stance: Stance, landing: Landing | None) -> Similarity:
    """The turn with which an object keeps its contact with a surface that slopes otherwise."""
    if landing is None or not landing.found or not stance.stands:
        return IDENTITY
    turn = turn_between(stance.up.numpy(), landing.normal.numpy())
    angle = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))))
    return replace(IDENTITY, turn=turn) if LEANS[0] <= angle <= LEANS[1] else IDENTITY


@torch.no_grad()
def place(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    placement: Placement,
    cameras: Sequence[Camera] = (),
) -> Outcome:
    """The scene with the object inside at another place, of another size, turned, or twice.

    It is set on the surface under it, lit as its new place is, and casts a soft shadow there; the
    hole that it leaves is filled. `cameras` say what left, right and back are; found if there are
    none. A whole scene is scaled and turned about its lowest point, and keeps its light. Raises
    UsageError for a region that is empty, a whole scene that is to go elsewhere, and values out of
    range.
    """
    check_placement(placement, inside, len(scene))
    check_finite(scene)
    if placement.is_nothing:
        return same(scene)
    seen_from = cameras_of(scene, cameras)
    around = place_of(scene, seen_from)
    scene, asked = scene.detach(), inside
    inside = torch.from_numpy(tidied(scene.means.numpy(), inside.numpy()))
    body = scene[inside]
    stance = stance_of(body, scene[~inside], around.up)
    if bool(inside.all()) and not placement.copy:
        rows = torch.arange(len(scene))
        return Outcome(moved(body, _grown(stance, placement)), rows, torch.ones_like(inside), ())
    if stance.stands and placement.offset[2] < 0 and placement.only_rises:
        return replace(same(scene), notes=(RESTS,))
    gone = same(scene) if placement.copy else remove(scene, asked, seen_from)
    to = placement.to
    other = scene[to.of] if isinstance(to, RelativePlace) and to.of is not None else body
    ground = Ground(gone.scene, around, seen_from)
    motion = motion_of(body, stance, placement, other, ground)
    there = moved(body, motion.similarity)
    light = Daylight(around, sun_of(scene, stance))
    turned = not np.allclose(motion.similarity.turn, np.eye(3))
    if light.sun is not None and (motion.landing is not None or turned):
        normals = estimate_normals(scene, seen_from, inside=inside).directions.double()
        turn = torch.from_numpy(motion.similarity.turn)
        there = relit_elsewhere(body, there, normals, turn, gone.scene, light)
    base = shaded(gone, there, motion.stance, light)
    rows = torch.full((len(body),), NEW) if placement.copy else inside.nonzero().squeeze(-1)
    return added(base, there, rows, notes_of(motion, there, ground))


def added(base: Outcome, body: Gaussians, rows: Tensor, notes: tuple[str, ...]) -> Outcome:
    """An outcome with an object behind its rows, whose own come from `rows` of the scene before."""
    changed = torch.ones(len(body), dtype=torch.bool)
    return Outcome(
        concatenate(base.scene, body.map(lambda field: field.to(base.scene.means))),
        torch.cat((base.origin, rows)),
        torch.cat((base.changed, changed)),
        (*base.notes, *notes),
    )


RESTS = "it rests on what is under it, and goes down no farther"
CROWDED = 0.05
"""Share of an object's outline over something that rises beside its foot, from which it is told."""
LEVEL = 0.01
"""Way up or down to the surface, of an object's height, from which it is told."""
FEW_SEE = 0.2
"""Share of the cameras with an object in their pictures, below which it is told."""
OVER_EDGE = 0.7
"""Share of its base that is carried, below which it is told."""


def notes_of(motion: Motion, body: Gaussians, ground: Ground) -> tuple[str, ...]:
    """Remarks for a person on how an object stands in the rest of a scene."""
    stance, landing = motion.stance, motion.landing
    notes = _to_cameras(body, stance.up, ground.cameras)
    if landing is not None and not landing.found:
        return (*notes, "nothing is under its new place: it stays at the height that it had")
    if not stance.stands:
        return (*notes, "it touches no surface")
    if motion.stopped > LEVEL * stance.height:
        notes.append(RESTS)
    if landing is not None:
        at = ", ".join(f"{each:.3g}" for each in stance.foot.tolist())
        notes.append(f"it stands at ({at}), {motion.way:.3g} world units from where it stood")
    if abs(motion.rise) > LEVEL * stance.height:
        way = "higher" if motion.rise > 0 else "lower"
        notes.append(f"what it stands on there is {abs(motion.rise):.3g} world units {way}")
    share, crowded = carried(body, stance, ground.scene)
    if share < OVER_EDGE:
        notes.append(f"{1 - share:.0%} of its base is over the edge of what carries it")
    if crowded > CROWDED:
        notes.append("it reaches into what stands there: put it farther away, or make it smaller")
    return tuple(notes)


def _to_cameras(body: Gaussians, up: Float[Tensor, "3"], cameras: Sequence[Camera]) -> list[str]:
    """Remarks where cameras are as near to the middle of an object as its ends are, and where few
    have it in their pictures."""
    middle, radius = middle_of(body, up), size_of(body) / 2
    near, seeing = 0, 0
    for camera in cameras:
        near += float((camera.center - middle).norm()) < radius
        seeing += bool(camera.pictured(middle)[2])
    notes = list[str]()
    if near:
        told = f"{near} of {len(cameras)} cameras are in it or close"
        notes.append(f"{told}: look at it from farther away")
    if seeing < FEW_SEE * len(cameras):
        told = f"{seeing} of {len(cameras)} cameras have it in their pictures"
        notes.append(f"{told}: look at it from elsewhere, or say another place")
    return notes
