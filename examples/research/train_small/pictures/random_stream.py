"""Random numbers one at a time, all from one generator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import torch

T = TypeVar("T")

BLOCK = 1024  # numbers drawn at once: a call of the generator for each number would dominate


class RandomStream:
    """Random scalars from a generator; `generator` itself serves for noise as whole tensors."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator = generator
        self._buffer: list[float] = []

    def __call__(self, low: float | int = 0.0, high: float | int = 1.0) -> float:
        """Uniform in [low, high)."""
        if not self._buffer:
            self._buffer = torch.rand(BLOCK, generator=self.generator).tolist()
        return low + (high - low) * self._buffer.pop()

    def integer(self, low: int, high: int) -> int:
        """One of low, ..., high, all equally likely."""
        return low + min(int(self() * (high - low + 1)), high - low)

    def chance(self, probability: float | int) -> bool:
        """True with this probability."""
        return self() < probability

    def pick(self, choices: Sequence[T]) -> T:
        """One of the choices; an item listed twice is twice as likely."""
        return choices[self.integer(0, len(choices) - 1)]
