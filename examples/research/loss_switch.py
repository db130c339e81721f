"""Updates that are no option of gsedit: the paper's random switch, and steps where a solve does."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch

from gsedit.fitting.loss_terms import LossTerm
from gsedit.fitting.settings import UpdateSettings


@dataclass(frozen=True)
class SteppedUpdate(UpdateSettings):
    """Settings of an update in steps of Adam, whatever the loss."""

    @property
    def is_quadratic(self) -> bool:
        """False: a solve is not to be used."""
        return False


@dataclass(frozen=True)
class SwitchedUpdate(UpdateSettings):
    """Settings of an update whose steps fit the Gram matrices alone or the other terms alone."""

    switch: float = 0.5
    """Probability of the Gram matrices."""

    @cached_property
    def _random(self) -> torch.Generator:
        return torch.Generator().manual_seed(0)

    @property
    def terms(self) -> tuple[LossTerm, ...]:
        """The terms of one step, drawn anew each time."""
        style = float(torch.rand((), generator=self._random)) < self.switch
        return tuple(term for term in super().terms if (term.name == "gram") == style)
