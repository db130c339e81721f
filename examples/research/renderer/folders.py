"""The folder of a sweep: measurements, a table, two plots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gsedit.bench.renderer.speed import Workload
from gsedit.bench.results import write_measurements, write_text
from gsedit.runs.events import Event
from research.renderer import measurements
from research.renderer.measurements import RenderMeasurement
from research.renderer.plots import work_precision
from research.renderer.sweep import SweepPlan, sweep

SWEEP_ROWS, SWEEP_TABLE = "bench.jsonl", "bench.md"
IMAGE_PLOT, GRADIENT_PLOT = "image_error.png", "gradient_error.png"
SWEEP_FILES = (SWEEP_ROWS, SWEEP_TABLE, IMAGE_PLOT, GRADIENT_PLOT)


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
