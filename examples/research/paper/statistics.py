"""Statistics of error curves: how soon an error is reached, at any cost of the 2D editor."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from gsedit.bench.edit import Point
from research.paper.runs import Record

COSTLY_SECONDS = 2.0
"""An evaluation of InstructPix2Pix's network at full size (860 M weights, random) at 256x256
pixels in a batch of 4, on the two cores that these pages are measured on; 6.6 GB."""
PAPER_STEP, PAPER_EVALUATION = 0.15, 30 / (4 * 3 * 50)
"""Seconds on the paper's A100: a step of fitting, and an evaluation, from its 30 s a batch of four
views in 50 steps under three conditions."""
AS_GOOD = 1.05
"""An error up to this factor of iterative's final one has reached it: 0.4 dB."""
LAST = 0.1
"""The final error is the mean over this last share of the steps: single points of iterative
fluctuate."""


@dataclass(frozen=True)
class Costs:
    """Seconds of an evaluation of the network and of a fitting step."""

    name: str
    evaluation: float | None = None
    """Seconds an evaluation; None: as measured."""
    step: float | None = None
    """None: as measured, with everything else that is not the editor."""

    def seconds(self, point: Point) -> float:
        """At these costs, since the first action."""
        editing = point.editing if self.evaluation is None else self.evaluation * point.evaluations
        rest = point.seconds - point.editing if self.step is None else self.step * point.steps
        return editing + rest


MEASURED = Costs("this editor, as measured")
COSTLY = Costs("an editor of Stable Diffusion's cost here", COSTLY_SECONDS)
PAPERS = Costs("the paper's costs on an A100", PAPER_EVALUATION, PAPER_STEP)
REGIMES = {"measured": MEASURED, "costly": COSTLY, "paper": PAPERS}


@dataclass(frozen=True)
class Spread:
    """Mean, deviation, median and range of some numbers."""

    mean: float | None
    deviation: float | None
    """Sample standard deviation; None of fewer than two."""
    median: float | None
    low: float | None
    high: float | None
    count: int


def spread(values: Iterable[float | None]) -> Spread:
    """Summarize the numbers that are not None."""
    numbers = [float(value) for value in values if value is not None]
    if not numbers:
        return Spread(None, None, None, None, None, 0)
    deviation = statistics.stdev(numbers) if len(numbers) > 1 else None
    return Spread(
        statistics.fmean(numbers), deviation, statistics.median(numbers), min(numbers),
        max(numbers), len(numbers),
    )  # fmt: skip


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
        return costs.seconds(self.iterative) / costs.seconds(self.own)


def race(record: Record, iterative: Record) -> Race:
    """To an error up to AS_GOOD times iterative's final one, or to its best where that is more."""
    best = min(e for point, e in zip(iterative.curve, iterative.errors) if point.steps)
    goal = max(AS_GOOD * final_error(iterative), best)
    theirs = reached(iterative, goal)
    assert theirs is not None
    return Race(reached(record, goal), theirs)


def median_scene(races: Mapping[str, Sequence[Race]], costs: Costs) -> float | None:
    """The speed-up on the median scene, of each scene the median over its seeds; of an even number
    the lower of the two in the middle, since one of them may not be reached."""
    scenes = [statistics.median_low(r.speed_up(costs) for r in group) for group in races.values()]
    return statistics.median_low(scenes) if scenes else None
