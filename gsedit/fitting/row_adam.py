"""Adam (Kingma and Ba 2015) of which a step touches some rows, and the others move all the same.

A row without a gradient still moves under Adam, by its momentum, which fades. Here such a row is
left alone until it is needed, and then makes up for the steps that it missed in one: over k steps
without a gradient its moments are m b1^j and v b2^j, so that it moves by

    m / sqrt(v) * sum_j rate_j sqrt(1 - b2^t_j) / (1 - b1^t_j) (b1 / sqrt(b2))^j,

a product of its own moments and a number that depends on the steps alone. To rounding, this equals
a step over all rows.

`n` rows, of which a step has `m`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsedit.fitting.adam_rows import BETA_1, BETA_2, Moving, settle, step

FADING = BETA_1 / sqrt(BETA_2)
"""By which the movement of a row without a gradient is smaller at each step."""


class RowAdam:
    """The moments of `n` rows of named tensors, and the step at which each row was last moved."""

    def __init__(
        self, count: int, *, shares: Mapping[str, Tensor] | None = None, compiled: bool = False
    ) -> None:
        """`shares`, by name: what the rate of each of a row's values is multiplied by, in a shape
        that broadcasts to a row's; 1 for names that are not there. `compiled`: steps by the C++
        kernel, where there is one; equal to rounding."""
        self.shares = shares or {}
        self.compiled = compiled
        self.steps = 0
        self._moments: dict[str, tuple[Tensor, Tensor]] = {}
        self._settled = 0
        """Step up to which all rows are moved."""
        self._last = torch.zeros(count, dtype=torch.int32)
        """The same of each row."""
        self._missed: dict[str, np.ndarray] = {}
        """By name: how far a row of unit m / sqrt(v), last moved at step `_settled` + i, has to
        move."""

    @torch.no_grad()
    def step(
        self,
        values: Mapping[str, Tensor],
        gradients: Mapping[str, Tensor],
        rates: Mapping[str, float],
        rows: Int[Tensor, " m"] | None = None,
    ) -> None:
        """Move `values`, in place, against the gradients of their `rows` (None: of all rows).

        The rows must be settled. A name without a gradient has a gradient of zero.
        """
        self.steps += 1
        bias_1, bias_2 = 1 - BETA_1**self.steps, sqrt(1 - BETA_2**self.steps)
        for name, rate in rates.items():
            self._count_missed(name, rate * bias_2 / bias_1)
            gradient = gradients.get(name)
            if gradient is None and name not in self._moments:
                continue
            if name not in self._moments:
                zeros = torch.zeros_like(values[name])
                self._moments[name] = zeros, torch.zeros_like(zeros)
            moving = Moving(values[name].detach(), *self._moments[name])
            shares = self.shares.get(name)
            step(moving, gradient, rows, rate / bias_1, bias_2, shares, compiled=self.compiled)
        if rows is None:
            self._settle_all()
        else:
            self._last[rows] = self.steps

    def _count_missed(self, name: str, distance: float) -> None:
        """A row moves by `distance` (times its m / sqrt(v)) in this step, less if it is behind."""
        missed = self._missed.get(name, np.zeros(1))
        behind = np.arange(len(missed), 0, -1)
        self._missed[name] = np.append(missed + distance * FADING**behind, 0.0)

    def _settle_all(self) -> None:
        self._settled = self.steps
        self._last.fill_(self.steps)
        self._missed = {}

    @torch.no_grad()
    def settle(self, values: Mapping[str, Tensor], rows: Int[Tensor, " m"] | None = None) -> None:
        """Move the rows (None: all) by what they missed, in place."""
        if self._settled == self.steps:
            return
        behind = self._last < self.steps if rows is None else self._last[rows] < self.steps
        late = behind.nonzero().squeeze(-1) if rows is None else rows[behind]
        since = self._last[late].long()
        for name, moments in self._moments.items():
            missed = torch.from_numpy(self._missed[name])[since - self._settled]
            moving = Moving(values[name].detach(), *moments)
            steps, shares = self.steps - since, self.shares.get(name)
            settle(moving, late, missed, steps, shares, compiled=self.compiled)
        if rows is None:
            self._settle_all()
        else:
            self._last[late] = self.steps

    def selected(self, origin: Int[Tensor, " m"], fresh: Bool[Tensor, " m"]) -> RowAdam:
        """For other rows: row i has row origin[i]'s moments, zero where it is fresh. All rows must
        be settled."""
        other = RowAdam(len(origin), shares=self.shares, compiled=self.compiled)
        other.steps = self.steps
        other._settle_all()
        for name, moments in self._moments.items():
            first, second = (moment[origin] for moment in moments)
            first[fresh] = 0
            second[fresh] = 0
            other._moments[name] = first, second
        return other

    def state(self) -> dict[str, Tensor]:
        """The moments by name and the number of steps. All rows must be settled."""
        named = {"steps": torch.tensor(self.steps)}
        for name, (first, second) in self._moments.items():
            named |= {f"first.{name}": first, f"second.{name}": second}
        return named

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Continue from a `state` of as many rows."""
        self.steps = int(state["steps"])
        names = [key.removeprefix("first.") for key in state if key.startswith("first.")]
        self._moments = {
            name: (state[f"first.{name}"].clone(), state[f"second.{name}"].clone())
            for name in names
        }
        self._settle_all()
