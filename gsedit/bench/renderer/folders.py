"""The folders that benchmarks of the renderer leave: measurements, a table, plots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gsedit.bench.renderer import measurements, stability
from gsedit.bench.renderer.measurements import RenderMeasurement
from gsedit.bench.renderer.plots import work_precision
from gsedit.bench.renderer.stability import EdgeCaseMeasurement
from gsedit.bench.renderer.sweep import SweepPlan, sweep
from gsedit.bench.renderer.workloads import Workload
from gsedit.bench.results import write_measurements, write_text
from gsedit.reports.events import Event
from gsedit.reports.stopwatch import Stopwatch

SWEEP_ROWS, SWEEP_TABLE = "bench.jsonl", "bench.md"
IMAGE_PLOT, GRADIENT_PLOT = "image_error.png", "gradient_error.png"
SWEEP_FILES = (SWEEP_ROWS, SWEEP_TABLE, IMAGE_PLOT, GRADIENT_PLOT)
STABILITY_ROWS, STABILITY_TABLE = "stability.jsonl", "stability.md"


def sweep_to_folder(
    folder: Path, workloads: Sequence[Workload], plan: SweepPlan
) -> Iterator[Event | RenderMeasurement]:
    """`sweep`, written to a folder: SWEEP_ROWS meanwhile, then SWEEP_TABLE and the two plots.

    Table and plots of an earlier run are removed first. The reference's pictures stay in
    `references/` for the next run.
    """
    for name in (SWEEP_TABLE, IMAGE_PLOT, GRADIENT_PLOT):
        (folder / name).unlink(missing_ok=True)
    rows: list[RenderMeasurement] = []
    items = sweep(workloads, plan, folder / "references")
    yield from write_measurements(items, folder / SWEEP_ROWS, rows)
    write_text(folder / SWEEP_TABLE, measurements.table(rows))
    work_precision(rows, folder / IMAGE_PLOT, "image", overwrite=True)
    work_precision(rows, folder / GRADIENT_PLOT, "gradients", overwrite=True)


def stability_to_folder(folder: Path, *, quick: bool) -> Iterator[Event | EdgeCaseMeasurement]:
    """All edge cases, written to a folder: STABILITY_ROWS meanwhile, then STABILITY_TABLE."""
    rows: list[EdgeCaseMeasurement] = []
    items = _with_events(stability.measurements(quick=quick))
    yield from write_measurements(items, folder / STABILITY_ROWS, rows)
    write_text(folder / STABILITY_TABLE, stability.table(rows) + "\n")


def _with_events(
    rows: Iterator[EdgeCaseMeasurement],
) -> Iterator[Event | EdgeCaseMeasurement]:
    stopwatch = Stopwatch()
    for count, row in enumerate(rows, start=1):
        yield row
        yield Event("stability", stopwatch.seconds, count, note=row.name)
