"""Time of pieces of work that take turns, so that a busy machine slows all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

Name = TypeVar("Name", str, int)


@dataclass(frozen=True)
class Timing:
    """Medians of some runs, seconds."""

    wall: float
    cpu: float
    """Processor time of all threads together."""
    runs: int


def timed(work: Callable[[], Any], runs: int, budget: float = inf) -> tuple[Timing, Any]:
    """Medians of a piece of work, and the result of its last run; see `timed_together`."""
    timings, results = timed_together({"": work}, runs, budget)
    return timings[""], results[""]


def timed_together(
    works: Mapping[Name, Callable[[], Any]], runs: int, budget: float = inf
) -> tuple[dict[Name, Timing], dict[Name, Any]]:
    """Medians after a warm-up, and results of the last runs, of works that take turns.

    No run begins once `budget` seconds are spent. Where the warm-up alone spends them, it is the
    one run that counts: slow work is not run twice.
    """
    began = time.perf_counter()
    samples: dict[Name, list[tuple[float, float]]] = {name: [] for name in works}
    results: dict[Name, Any] = {}
    for turn in range(runs + 1):
        if turn and time.perf_counter() - began > budget:
            break
        for name, work in works.items():
            results.pop(name, None)  # memory of the run before must not weigh on this one
            wall, cpu = time.perf_counter(), time.process_time()
            results[name] = work()
            samples[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: _medians(taken) for name, taken in samples.items()}, results


def _medians(samples: list[tuple[float, float]]) -> Timing:
    counted = samples[1:] or samples
    wall, cpu = (statistics.median(column) for column in zip(*counted))
    return Timing(wall, cpu, len(counted))
