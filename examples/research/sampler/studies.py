"""All measurements of the sampler, one study after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import chain

from gsedit.bench.provenance import provenance
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from research.sampler.consensus_study import consensus_study
from research.sampler.cost_study import cost_study
from research.sampler.measurements import SamplerMeasurement
from research.sampler.solver_study import GUIDANCE, STEPS, WIDTHS, solver_study, stiff_study


def measure_sampler(*, quick: bool = False, runs: int = 5) -> Iterator[Event | SamplerMeasurement]:
    """Each measurement of each study, after an event that names it.

    `quick`: fewer widths, scales, steps and seeds.
    """
    studies = chain(
        solver_study(WIDTHS[::4], GUIDANCE[:2], STEPS[:4]) if quick else solver_study(),
        stiff_study((1, 20) if quick else (1, 2, 20, 1000)),
        consensus_study(1 if quick else 3),
        cost_study(runs),
    )
    stopwatch = Stopwatch()
    for count, row in enumerate(studies, start=1):
        note = f"{row.problem}: {row.variant}, {row.steps} steps"
        yield Event("sampler", stopwatch.seconds, count, note=note)
        yield replace(row, **asdict(provenance()))
