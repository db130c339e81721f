"""Measure the sampler: `python -m research.sampler`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.results import write_text
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch
from research.command import Output, Quick, collect, print_message, print_result, require_new, run
from research.figures import Point, draw_errors
from research.provenance import provenance, write_measurements
from research.sampler.consensus_study import consensus_study
from research.sampler.measurements import SamplerMeasurement, table
from research.sampler.solver_study import GUIDANCE, STEPS, WIDTHS, solver_study

ROWS, TABLE, PLOT = "bench.jsonl", "bench.md", "evaluations.png"
CEILING = 1e3
"""Larger errors are drawn here: a result that left the data is wrong at any distance."""


def measure_sampler(*, quick: bool = False, runs: int = 5) -> Iterator[Event | SamplerMeasurement]:
    """Each measurement of each study, after an event that names it.

    `quick`: fewer widths, scales, steps and seeds.
    """
    studies = chain(
        solver_study(WIDTHS[::4], GUIDANCE[:2], STEPS[:4], runs)
        if quick
        else solver_study(runs=runs),
        consensus_study(1 if quick else 3),
    )
    stopwatch = Stopwatch()
    for count, row in enumerate(studies, start=1):
        note = f"{row.problem}: {row.variant}, {row.steps} steps"
        yield Event("sampler", stopwatch.seconds, count, note=note)
        yield replace(row, **asdict(provenance()))


def lines_of(rows: Iterable[SamplerMeasurement]) -> dict[str, dict[str, list[Point]]]:
    """A panel a problem, a line a solver: evaluations of the network, and the error."""
    panels: dict[str, dict[str, list[Point]]] = {}
    for row in rows:
        if row.study == "solver" and row.error is not None:
            point = float(row.evaluations), min(row.error, CEILING)
            panels.setdefault(row.problem, {}).setdefault(row.variant, []).append(point)
    return panels


def sampler(
    out: Output = Path("out/sampler"),
    runs: Annotated[int, typer.Option(min=1, help="Number of runs; times are medians.")] = 3,
    quick: Quick = False,
) -> None:
    """Measure the errors of the solvers, and variants of consensus.

    Writes bench.jsonl, bench.md and a plot.
    """
    require_new(out)
    rows: list[SamplerMeasurement] = []
    items = measure_sampler(quick=quick, runs=runs)
    collect(write_measurements(items, out / ROWS, rows))
    write_text(out / TABLE, table(rows))
    draw_errors(lines_of(rows), out / PLOT, cost="evaluations of the network", error="RMS error")
    print_message(f"{len(rows)} measurements are in {out}; look at {out / PLOT}")
    print_result(table(rows))


if __name__ == "__main__":
    run(sampler)
