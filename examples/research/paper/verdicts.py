"""Verdicts on effects that were measured on several scenes, with several editors and seeds.

An effect is a number a run, positive in the direction that is claimed, 0 where there is none.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Literal

from gsedit.measures.interval import tail_of

Verdict = Literal["reproduced", "direction only", "no effect seen", "opposite"]
Effects = Mapping[str, Mapping[str, Sequence[float]]]
"""scene -> editor -> an effect a seed."""
Center = Callable[[Sequence[float]], float]
RESAMPLES = 2000


@dataclass(frozen=True)
class Judgement:
    """An effect over all runs, and what it says."""

    effect: float
    low: float
    high: float
    """Ends of the interval of 95 %."""
    scenes: int
    runs: int
    verdict: Verdict


def judge(effects: Effects, half: float, center: Center = statistics.fmean) -> Judgement | None:
    """Judge effects by all their runs; None where there is none.

    `half`: half of the size that is claimed. `center` is taken over the seeds of a scene, then over
    the scenes of an editor; editors count alike. The interval is a bootstrap over scenes, and over
    the seeds of each. On one scene an effect is never more than `direction only`, and one seed
    there shows none: nothing tells how it varies.
    """
    found = {s: {e: v for e, v in editors.items() if v} for s, editors in effects.items()}
    found = {scene: editors for scene, editors in found.items() if editors}
    runs = sum(len(values) for editors in found.values() for values in editors.values())
    if not runs:
        return None
    scenes = list(found)
    effect = _pooled([found[scene] for scene in scenes], center)
    low, high = -inf, inf
    repeated = max(len(values) for editors in found.values() for values in editors.values()) > 1
    if len(found) > 1 or repeated:
        low, high = _interval(found, center)
    verdict = verdict_of(effect, low, high, half if len(scenes) > 1 else inf)
    return Judgement(effect, low, high, len(scenes), runs, verdict)


def verdict_of(effect: float, low: float, high: float, half: float) -> Verdict:
    """The rule: an interval without 0 shows a direction, half of the size reproduces the claim."""
    if low > 0:
        return "reproduced" if effect >= half else "direction only"
    return "opposite" if high < 0 else "no effect seen"


def _interval(found: Effects, center: Center) -> tuple[float, float]:
    """Expanded percentiles of the bootstrap over scenes and seeds, see `tail_of`."""
    random, scenes = Random(0), list(found)
    clusters = len(scenes)
    if clusters == 1:
        clusters = max(len(values) for values in found[scenes[0]].values())
    drawn = []
    for _ in range(RESAMPLES):
        chosen = [found[scene] for scene in random.choices(scenes, k=len(scenes))]
        resampled = [{e: random.choices(v, k=len(v)) for e, v in each.items()} for each in chosen]
        drawn.append(_pooled(resampled, center))
    drawn.sort()
    rank = int(tail_of(max(clusters, 2)) * RESAMPLES)
    return drawn[rank], drawn[-1 - rank]


def _pooled(scenes: Sequence[Mapping[str, Sequence[float]]], center: Center) -> float:
    """The mean over editors of their centers."""
    editors = dict.fromkeys(editor for scene in scenes for editor in scene)
    return statistics.fmean(
        center([center(scene[editor]) for scene in scenes if editor in scene]) for editor in editors
    )
