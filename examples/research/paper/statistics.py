"""Statistics of error curves: how soon an error is reached, at any cost of the 2D editor."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from gsedit.bench.edit import Point
from research.paper.costs import Costs
from research.paper.runs import Record

AS_GOOD = 1.05
"""An error up to this factor of iterative's final one has reached it: 0.4 dB."""
LAST = 0.1
"""The final error is the mean over this last share of the steps: single points of iterative
fluctuate."""


class Spread(NamedTuple):
    """Mean, sample standard deviation (0 of a single number), median and range of some numbers."""

    mean: float
    deviation: float
    median: float
    low: float
    high: float


def spread(values: Iterable[float | None]) -> Spread | None:
    """Summarize the numbers that are not None; None where there is none."""
    found = [float(value) for value in values if value is not None]
    if not found:
        return None
    deviation = statistics.stdev(found) if len(found) > 1 else 0.0
    return Spread(statistics.fmean(found), deviation, statistics.median(found), min(found),
                  max(found))  # fmt: skip


def final_error(record: Record) -> float:
    """RMSE, the mean over the last tenth of the steps."""
    begin = (1 - LAST) * record.curve[-1].steps
    last = [e for point, e in zip(record.curve, record.errors) if point.steps >= begin]
    return statistics.fmean(last)


def reached(record: Record, error: float) -> Point | None:
    """The first point, once the scene is fitted, of at most that error; None: there is none."""
    return next((p for p, e in zip(record.curve, record.errors) if p.steps and e <= error), None)


@dataclass(frozen=True)
class Race:
    """One strategy against iterative on the same scene, editor and seed."""

    own: Point | None
    """First point at which the strategy reaches iterative's final error; None: it does not."""
    iterative: Point
    """First point at which iterative reaches it."""

    def speed_up(self, costs: Costs) -> float:
        """Iterative's seconds over the strategy's; 0 where the error is not reached."""
        if self.own is None:
            return 0.0
        return costs.seconds(self.iterative) / max(costs.seconds(self.own), 1e-9)


def race(record: Record, iterative: Record, share: float = 1.0) -> Race:
    """To an error up to AS_GOOD times iterative's final one, or to its best where that is more.

    `share`: of the decibels from the unedited scene's error to that; a half: half of the way.
    """
    best = min(e for point, e in zip(iterative.curve, iterative.errors) if point.steps)
    goal = max(AS_GOOD * final_error(iterative), best)
    goal = max(goal * (iterative.errors[0] / goal) ** (1 - share), best)
    theirs = reached(iterative, goal)
    assert theirs is not None
    return Race(reached(record, goal), theirs)
