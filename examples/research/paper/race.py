"""How soon an error is reached: races against iterative, at any cost of the 2D editor."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from research.paper.observe import Point
from research.paper.runs import Record

AS_GOOD = 1.05
"""An error up to this factor of iterative's final one has reached it: 0.4 dB."""
LAST = 0.1
"""The final error is the mean over this last share of the steps: single points of iterative
fluctuate."""
REAL_EVALUATION = 0.34
"""Processor seconds of an evaluation of InstructPix2Pix for a view of 256 pixels: OpenVINO in
bfloat16 on two cores of a Xeon with AMX (docs/measurements/editors.md)."""
CONDITIONS = 3
"""Evaluations of InstructPix2Pix a denoising step: with words and picture, with one, with none."""


@dataclass(frozen=True)
class Costs:
    """Seconds of an evaluation of the network; everything else is as measured."""

    evaluation: float | None = None
    """Processor seconds; None: as measured."""

    def seconds(self, point: Point) -> float:
        """Processor seconds at these costs, since the first action."""
        editing = (
            point.editing_cpu if self.evaluation is None else self.evaluation * point.evaluations
        )
        return editing + point.cpu - point.editing_cpu


def regimes(branches: int = CONDITIONS) -> dict[str, Costs]:
    """As measured; and with InstructPix2Pix here.

    `branches`: evaluations a step of the editor that ran in the real one's place, which has three.
    """
    return {"measured": Costs(), "real": Costs(CONDITIONS / branches * REAL_EVALUATION)}


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
