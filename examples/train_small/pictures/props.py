"""What stands around a subject and below it: trunks, bushes, rocks, boxes, pedestals."""

from __future__ import annotations

from math import cos, pi, sin

from train_small.pictures.palette import FOLIAGE, GROUND, PATCH, ROCK, TRUNK
from train_small.pictures.randomness import Dice
from train_small.pictures.solids import Solid, ball, box, drum
from train_small.pictures.vectors import turned


def pedestal(dice: Dice, height: float) -> list[Solid]:
    """What the subject stands on, its top at `height` (world units)."""
    half, wide = height / 2, dice(0.35, 1.3)
    material = dice.pick((0, GROUND, PATCH, ROCK, ROCK, 1))
    if dice.chance(0.6):
        size = (wide, wide * dice(0.5, 1.0), half)
        parts = [box((0, 0, half), size, material, turned(dice(0, pi)))]
    else:
        parts = [drum((0, 0, half), wide, half, material, dice(0.85, 1.0))]
    if dice.chance(0.3):
        centre = (dice(-0.3, 0.3), dice(-0.3, 0.3), 0.04)
        parts.append(drum(centre, wide * dice(1.2, 2.5), 0.04, ROCK, 0.95))
    return _not_subject(parts)


def random_props(dice: Dice, heading: float) -> list[Solid]:
    """Up to six things behind and beside the subject, for a camera of that heading (radians)."""
    parts = []
    for _ in range(dice.pick((0, 0, 1, 2, 4, 6))):
        angle, far = heading + dice(-0.8, 0.8), dice(1.3, 6.0)
        x, y, size = far * cos(angle), far * sin(angle), dice(0.15, 0.7)
        parts += dice.pick((_trunk, _bush, _rock, _crate))(dice, x, y, size)
    return _not_subject(parts)


def _trunk(dice: Dice, x: float, y: float, _size: float) -> list[Solid]:
    return [drum((x, y, 4.0), dice(0.08, 0.4), 4.0, TRUNK, dice(0.6, 1.0))]


def _bush(dice: Dice, x: float, y: float, size: float) -> list[Solid]:
    parts = []
    for _ in range(3):
        centre = (x + dice(-0.5, 0.5), y + dice(-0.5, 0.5), size * dice(0.2, 1.2))
        half = (size, size * dice(0.7, 1.2), size * dice(0.6, 1.1))
        parts.append(ball(centre, half, FOLIAGE))
    return parts


def _rock(dice: Dice, x: float, y: float, size: float) -> list[Solid]:
    half = (size, size * dice(0.6, 1.2), size * dice(0.4, 0.8))
    return [ball((x, y, 0.3 * size), half, ROCK, turned(dice(0, 6)))]


def _crate(dice: Dice, x: float, y: float, size: float) -> list[Solid]:
    half = (size * dice(0.2, 2), size * dice(0.2, 1), size)
    return [box((x, y, size), half, dice.pick((1, PATCH, ROCK)), turned(dice(0, 6)))]


def _not_subject(parts: list[Solid]) -> list[Solid]:
    return [part._replace(subject=False) for part in parts]
