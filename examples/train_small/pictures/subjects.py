"""What pictures are of: makers of subjects, each as likely as it is often listed."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

from train_small.pictures.creatures import bird, bust, figure, quadruped, sitter
from train_small.pictures.randomness import Dice
from train_small.pictures.solids import Solid, placed
from train_small.pictures.things import blocks, boulders, car, furniture, tower, vase

SUBJECTS: tuple[Callable[[Dice], list[Solid]], ...] = (
    quadruped, quadruped, quadruped, quadruped, sitter, sitter, bust, bust, vase, furniture, blocks,
    car, boulders, tower, bird, figure,
)  # fmt: skip


def random_subject(dice: Dice) -> tuple[list[Solid], float]:
    """A subject's solids, turned and set at a height above the ground, and that height."""
    parts = dice.pick(SUBJECTS)(dice)
    if dice.chance(0.08):  # two of them, the second beside the first
        second, yaw, scale = dice.pick(SUBJECTS)(dice), dice(0, 6.3), dice(0.5, 0.9)
        parts += placed(second, yaw, scale, (dice(-0.5, 0.5), 0.7, 0.0))
    height = dice.pick((0.0, 0.0, dice(0.03, 0.15), dice(0.1, 0.6)))
    return placed(parts, dice(0, 2 * pi), 1.0, (0.0, 0.0, height)), height
