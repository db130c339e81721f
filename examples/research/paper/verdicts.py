"""Verdicts on effects that were measured on several scenes, with several editors and seeds.

An effect is a number a run, positive in the direction that is claimed, 0 where there is none.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf, sqrt
from typing import Literal, NamedTuple

from scipy.special import bdtr, stdtrit

Verdict = Literal[
    "reproduced", "direction only", "less than half", "not decided", "opposite direction only",
    "opposite", "not reached",
]  # fmt: skip
Effects = Mapping[str, Mapping[str, Sequence[float]]]
"""scene -> editor -> an effect a seed."""
TAIL = 0.025
"""Share of either side of an interval of 95 %."""


@dataclass(frozen=True)
class Judgement:
    """An effect over all runs, and what it says."""

    effect: float
    low: float
    high: float
    """Ends of the interval of 95 %; -inf and inf where the runs tell none."""
    scenes: int
    runs: int
    verdict: Verdict

    @property
    def has_interval(self) -> bool:
        """Whether the runs tell how the effect varies."""
        return (self.low, self.high) != (-inf, inf)


class _Mean(NamedTuple):
    """An editor's mean effect, its squared standard error, and the error's degrees of freedom."""

    effect: float
    variance: float
    freedom: int


def judge(effects: Effects, half: float) -> Judgement | None:
    """Judge differences by all their runs; None where there is none.

    `half`: half of the size that is claimed. The effect is the mean over the seeds of a scene, then
    over the scenes of an editor, then over the editors, which are not a sample of others. The
    interval is Student's, of an editor over its scenes, or over the seeds where it has one scene;
    of several editors by Welch's and Satterthwaite's rule, as if they varied apart.
    """
    means = [_mean(scenes) for scenes in by_editor(effects).values()]
    if not means:
        return None
    effect, count = statistics.fmean(each.effect for each in means), len(means)
    low, high = -inf, inf
    if all(each.freedom for each in means):
        width = _student(means) * sqrt(sum(each.variance for each in means)) / count
        low, high = effect - width, effect + width
    return _judged(effects, effect, (low, high), half)


def judge_factors(effects: Effects, half: float) -> Judgement | None:
    """Judge logarithms of factors, -inf of a run that does not get there; None without runs.

    The effect is the median over an editor's and scene's seeds, then over all editors and scenes.
    The interval is of order statistics, so it asks only which are larger; fewer than six tell none.
    A median that does not get there is no speed: where the interval holds no gain, or no run got
    there, the verdict is "not reached", never "opposite".
    """
    found = _medians(effects)
    if not found:
        return None
    rank = _rank(len(found))
    ends = (found[rank - 1], found[-rank]) if rank else (-inf, inf)
    judged = _judged(effects, statistics.median(found), ends, half)
    if judged.effect == -inf and (ends[1] < 0 or found[-1] == -inf):
        return replace(judged, verdict="not reached")
    return judged


def by_editor(effects: Effects) -> dict[str, list[Sequence[float]]]:
    """The scenes' effects of each editor, without scenes that have none."""
    found: dict[str, list[Sequence[float]]] = {}
    for editors in effects.values():
        for editor, values in editors.items():
            if values:
                found.setdefault(editor, []).append(values)
    return found


def verdict_of(effect: float, low: float, high: float, half: float) -> Verdict:
    """The rule: an interval without 0 shows a direction, half of the size reproduces the claim; one
    with 0 excludes half of the size or decides nothing."""
    if low > 0:
        return "reproduced" if effect >= half else "direction only"
    if high < 0:
        return "opposite" if effect <= -half else "opposite direction only"
    return "less than half" if high < half else "not decided"


def _judged(effects: Effects, effect: float, ends: tuple[float, float], half: float) -> Judgement:
    """On one scene an effect is never more than a direction."""
    counts = {scene: sum(map(len, editors.values())) for scene, editors in effects.items()}
    scenes = sum(count > 0 for count in counts.values())
    verdict = verdict_of(effect, *ends, half)
    if scenes == 1 and verdict in ("reproduced", "opposite"):
        verdict = "direction only" if verdict == "reproduced" else "opposite direction only"
    return Judgement(effect, *ends, scenes, sum(counts.values()), verdict)


def _mean(scenes: Sequence[Sequence[float]]) -> _Mean:
    means = [statistics.fmean(values) for values in scenes]
    units = means if len(means) > 1 else scenes[0]
    variance = statistics.variance(units) / len(units) if len(units) > 1 else inf
    return _Mean(statistics.fmean(means), variance, len(units) - 1)


def _student(means: Sequence[_Mean]) -> float:
    """Student's quantile at the degrees of freedom of the sum of the means."""
    total = sum(each.variance for each in means)
    if not total:
        return 0.0
    freedom = total**2 / sum(each.variance**2 / each.freedom for each in means)
    return float(stdtrit(freedom, 1 - TAIL))


def _medians(effects: Effects) -> list[float]:
    """Medians of an editor's and scene's seeds, or the seeds of a single one; ascending."""
    scenes = [values for each in by_editor(effects).values() for values in each]
    return sorted(map(statistics.median, scenes) if len(scenes) > 1 else chain(*scenes))


def _rank(count: int) -> int:
    """The largest r for which the r-th lowest and r-th highest of so many enclose the median; 0."""
    return int(sum(bdtr(r, count, 0.5) <= TAIL for r in range(count)))
