"""Random subjects: functions that make one; one that is listed twice is twice as likely."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

from research.train_small.pictures.creatures import bird, bust, figure, quadruped, sitter
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import Solid, placed
from research.train_small.pictures.things import blocks, boulders, car, furniture, tower, vase

SUBJECTS: tuple[Callable[[RandomStream], list[Solid]], ...] = (
    quadruped, quadruped, quadruped, quadruped, sitter, sitter, bust, bust, vase, furniture, blocks,
    car, boulders, tower, bird, figure,
)  # fmt: skip


def random_subject(rng: RandomStream) -> tuple[list[Solid], float]:
    """A subject's solids, turned and set at a height above the ground, and that height."""
    parts = rng.pick(SUBJECTS)(rng)
    if rng.chance(0.08):  # two of them, the second beside the first
        second, yaw, scale = rng.pick(SUBJECTS)(rng), rng(0, 6.3), rng(0.5, 0.9)
        parts += placed(second, yaw, scale, (rng(-0.5, 0.5), 0.7, 0.0))
    height = rng.pick((0.0, 0.0, rng(0.03, 0.15), rng(0.1, 0.6)))
    return placed(parts, rng(0, 2 * pi), 1.0, (0.0, 0.0, height)), height
