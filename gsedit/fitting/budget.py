"""Steps and seconds, and how much of a budget they are."""

from __future__ import annotations

from gsedit.reports.stopwatch import Stopwatch


class Budget:
    """Counts `step` and runs from its construction; None: no limit of that kind.

    `step` and `spent` seconds were done before.
    """

    def __init__(
        self, steps: int | None, seconds: float | None, *, step: int = 0, spent: float = 0.0
    ) -> None:
        self._steps, self._seconds = steps, seconds
        self._stopwatch = Stopwatch(spent)
        self.step = step

    @property
    def seconds(self) -> float:
        """Since the construction, with those spent before."""
        return self._stopwatch.seconds

    @property
    def progress(self) -> float:
        """Fraction of the budget that is spent: of the steps or of the seconds, the larger."""
        by_step = 0.0 if self._steps is None else self.step / self._steps
        by_time = 0.0 if self._seconds is None else self.seconds / self._seconds
        return max(by_step, by_time)

    @property
    def finished(self) -> bool:
        """Whether all of it is spent."""
        return self.progress >= 1

    @property
    def steps(self) -> int:
        """Expected number of steps in the whole budget."""
        return max(self.step, round(self.step / max(self.progress, 1e-9)))
