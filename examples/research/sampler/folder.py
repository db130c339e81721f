"""The folder that the sampler's benchmark leaves: measurements, a table, plots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gsedit.bench.results import write_measurements, write_text
from gsedit.runs.events import Event
from research.sampler.measurements import SamplerMeasurement, table
from research.sampler.plots import sweep_plot, work_precision
from research.sampler.studies import measure_sampler

ROWS, TABLE = "bench.jsonl", "bench.md"
EVALUATIONS_PLOT, SECONDS_PLOT, T_END_PLOT = "evaluations.png", "seconds.png", "t_end.png"
FILES = (ROWS, TABLE, EVALUATIONS_PLOT, SECONDS_PLOT, T_END_PLOT)


def sampler_to_folder(
    folder: Path, *, quick: bool, runs: int
) -> Iterator[Event | SamplerMeasurement]:
    """All studies, written to a folder: ROWS meanwhile, then TABLE and the three plots."""
    rows: list[SamplerMeasurement] = []
    items = measure_sampler(quick=quick, runs=runs)
    yield from write_measurements(items, folder / ROWS, rows)
    write_text(folder / TABLE, table(rows))
    work_precision(rows, folder / EVALUATIONS_PLOT, "evaluations", overwrite=True)
    work_precision(rows, folder / SECONDS_PLOT, "seconds", overwrite=True)
    sweep_plot(rows, folder / T_END_PLOT, overwrite=True)
