"""The similarity that takes an object from where it stands to where it is to stand.

World units, float64.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.objects.placing.free import Ground
from gsedit.objects.placing.landing import Landing, directions, land, point_beside
from gsedit.objects.placing.placement import Placement, RelativePlace, Triple
from gsedit.objects.placing.stance import STEP, Stance
from gsedit.scene.quaternions import axis_rotation, turn_between
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import gaussians_of, table_of
from rasterizer.scene import Gaussians

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
    body: Gaussians,
    stance: Stance,
    placement: Placement,
    other: Gaussians | None,
    ground: Ground,
) -> Motion:
    """The way to where a placement puts an object in a scene; `other` is what it is placed beside.

    What stands on a surface goes down no farther than to it.
    """
    grown = _grown(stance, placement)
    sized = moved(body, grown)
    tall = replace(stance, height=placement.scale * stance.height, gap=placement.scale * stance.gap)
    unit = tall.height if placement.unit is None else placement.unit
    right, back, rise = (unit * each for each in placement.offset)
    target, landing, risen = stance.foot, None, 0.0
    if placement.moves:
        target, ceiling = _asked(sized, tall, placement.to, other, ground)
        way = directions(ground.place)
        target = target + right * way["right"] + back * way["behind"]
        if placement.settle:
            onto = other if _on_top(placement.to) and other is not None else ground.scene
            there = moved(sized, _shift(target - stance.foot))
            landing = land(there, target, tall, onto, ceiling, ground.execution)
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
    under = land(body, target, stance, ground.scene, ceiling, ground.execution)
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
