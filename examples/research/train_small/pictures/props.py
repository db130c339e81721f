"""Objects around a subject and below it: trunks, bushes, rocks, boxes, pedestals."""

from __future__ import annotations

from math import cos, pi, sin

from research.train_small.pictures.palette import FOLIAGE, GROUND, PATCH, ROCK, TRUNK
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import Solid, ball, box, drum
from research.train_small.pictures.vectors import turned


def pedestal(rng: RandomStream, height: float) -> list[Solid]:
    """Stand of the subject, its top at `height` (world units)."""
    half, wide = height / 2, rng(0.35, 1.3)
    material = rng.pick((0, GROUND, PATCH, ROCK, ROCK, 1))
    if rng.chance(0.6):
        size = (wide, wide * rng(0.5, 1.0), half)
        parts = [box((0, 0, half), size, material, turned(rng(0, pi)))]
    else:
        parts = [drum((0, 0, half), wide, half, material, rng(0.85, 1.0))]
    if rng.chance(0.3):
        center = (rng(-0.3, 0.3), rng(-0.3, 0.3), 0.04)
        parts.append(drum(center, wide * rng(1.2, 2.5), 0.04, ROCK, 0.95))
    return _not_subject(parts)


def random_props(rng: RandomStream, heading: float) -> list[Solid]:
    """Up to six things behind and beside the subject, for a camera of that heading (radians)."""
    parts = []
    for _ in range(rng.pick((0, 0, 1, 2, 4, 6))):
        angle, far = heading + rng(-0.8, 0.8), rng(1.3, 6.0)
        x, y, size = far * cos(angle), far * sin(angle), rng(0.15, 0.7)
        parts += rng.pick((_trunk, _bush, _rock, _crate))(rng, x, y, size)
    return _not_subject(parts)


def _trunk(rng: RandomStream, x: float, y: float, _size: float) -> list[Solid]:
    return [drum((x, y, 4.0), rng(0.08, 0.4), 4.0, TRUNK, rng(0.6, 1.0))]


def _bush(rng: RandomStream, x: float, y: float, size: float) -> list[Solid]:
    parts = []
    for _ in range(3):
        center = (x + rng(-0.5, 0.5), y + rng(-0.5, 0.5), size * rng(0.2, 1.2))
        half = (size, size * rng(0.7, 1.2), size * rng(0.6, 1.1))
        parts.append(ball(center, half, FOLIAGE))
    return parts


def _rock(rng: RandomStream, x: float, y: float, size: float) -> list[Solid]:
    half = (size, size * rng(0.6, 1.2), size * rng(0.4, 0.8))
    return [ball((x, y, 0.3 * size), half, ROCK, turned(rng(0, 6)))]


def _crate(rng: RandomStream, x: float, y: float, size: float) -> list[Solid]:
    half = (size * rng(0.2, 2), size * rng(0.2, 1), size)
    return [box((x, y, size), half, rng.pick((1, PATCH, ROCK)), turned(rng(0, 6)))]


def _not_subject(parts: list[Solid]) -> list[Solid]:
    return [part._replace(subject=False) for part in parts]
