"""Random numbers one at a time, all from one generator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import torch

T = TypeVar("T")

BLOCK = 1024  # numbers drawn from the generator at once: a call each would take longer than its use


class Dice:
    """A source of random numbers; `generator` gives the noise that comes as whole tensors."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator = generator
        self._waiting: list[float] = []

    def __call__(self, low: float | int = 0.0, high: float | int = 1.0) -> float:
        """Uniform in [low, high)."""
        if not self._waiting:
            self._waiting = torch.rand(BLOCK, generator=self.generator).tolist()
        return low + (high - low) * self._waiting.pop()

    def whole(self, low: int, high: int) -> int:
        """One of low, ..., high."""
        return low + min(int(self() * (high - low + 1)), high - low)

    def chance(self, share: float | int) -> bool:
        """True in a share (in [0, 1]) of all throws."""
        return self() < share

    def pick(self, choices: Sequence[T]) -> T:
        """One of the choices; one that stands there twice comes up twice as often."""
        return choices[self.whole(0, len(choices) - 1)]
