"""Steps and seconds, and how much of a budget they are."""

from __future__ import annotations

import time
from collections.abc import Callable

from gsedit.run.stopwatch import Stopwatch

LEAST_STEPS = 10
"""Steps that are made after the seconds too: reading the photos may take all of a short budget."""


class Budget:
    """Counts `step` and runs from its construction; None: no limit of that kind.

    `step` and `spent` seconds were done before; seconds are the clock's.
    """

    def __init__(
        self,
        steps: int | None,
        seconds: float | None,
        *,
        step: int = 0,
        spent: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._steps, self._seconds = steps, seconds
        self._stopwatch = Stopwatch(spent, clock=clock)
        self.step = step

    def count_step(self) -> None:
        """A step is done."""
        self.step += 1

    @property
    def seconds(self) -> float:
        """Since the construction, with those spent before."""
        return self._stopwatch.seconds

    @property
    def progress(self) -> float:
        """Fraction of the budget that is spent: of the steps or of the seconds, the larger; 1 where
        the last step, or LEAST_STEPS, took longer."""
        by_step = 0.0 if self._steps is None else self.step / self._steps
        by_time = 0.0 if self._seconds is None else self.seconds / self._seconds
        return min(1.0, max(by_step, by_time))

    @property
    def finished(self) -> bool:
        """Whether all of it is spent, and LEAST_STEPS are done where there may be so many."""
        least = LEAST_STEPS if self._steps is None else min(LEAST_STEPS, self._steps)
        return self.progress >= 1 and self.step >= least

    @property
    def steps(self) -> int:
        """Expected number of steps in the whole budget."""
        return max(self.step, round(self.step / max(self.progress, 1e-9)))
