"""Measure the renderer's error against its run time: `python -m research.renderer`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.renderer.speed import Workload
from gsedit.bench.results import write_measurements, write_text
from gsedit.runs.events import Event
from research.command import Output, Points, Quick, collect, print_message, print_result, run
from research.curves import Point
from research.figures import draw_errors
from research.renderer.measurements import RenderMeasurement, table
from research.renderer.settings import KNOBS, parse_knobs
from research.renderer.sweep import SweepPlan, sweep
from research.renderer.workloads import standard_workloads

ROWS, TABLE, PLOT = "bench.jsonl", "bench.md", "image_error.png"
Scenes = Annotated[
    list[Path] | None,
    typer.Argument(metavar="SCENE", show_default=False, help="Fitted scenes to measure as well."),
]
Knobs = Annotated[
    str | None,
    typer.Option(
        "--knobs",
        metavar="stop,tile,...",
        show_default="all",
        help="Settings to vary, one at a time: " + ", ".join(KNOBS),
    ),
]


def renderer(
    scenes: Scenes = None,
    out: Output = Path("out/bench"),
    points: Points = None,
    knobs: Knobs = None,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs; times are medians.")] = 5,
    quick: Quick = False,
) -> None:
    """Vary one setting of the renderer at a time, on synthetic and given scenes.

    Writes bench.jsonl, bench.md and a plot; those of an earlier run are replaced.
    """
    names = tuple(KNOBS) if knobs is None else parse_knobs(knobs)
    plan = SweepPlan(names, runs, quick=quick)
    if points is None:
        print_message("the garden is left out: give its points with --points FILE or GSEDIT_GARDEN")
    workloads = standard_workloads(scenes or [], points, quick=quick)
    rows = collect(sweep_to_folder(out, workloads, plan))
    print_message(f"{len(rows)} measurements are in {out}; look at {out / PLOT}")
    print_result(str(out / TABLE))


def sweep_to_folder(
    folder: Path, workloads: Sequence[Workload], plan: SweepPlan
) -> Iterator[Event | RenderMeasurement]:
    """`sweep`, written to a folder: ROWS meanwhile, then TABLE and PLOT.

    Table and plot of an earlier run are removed first. The reference's pictures stay in
    `references/` for the next run.
    """
    for name in (TABLE, PLOT):
        (folder / name).unlink(missing_ok=True)
    rows: list[RenderMeasurement] = []
    items = sweep(workloads, plan, folder / "references")
    yield from write_measurements(items, folder / ROWS, rows)
    write_text(folder / TABLE, table(rows))
    panels = {scene: lines_of(group) for scene, group in groupby(rows, key=lambda row: row.scene)}
    draw_errors(panels, folder / PLOT, cost="forward, s", error="mean error of a color")


def lines_of(rows: Iterable[RenderMeasurement]) -> dict[str, list[Point]]:
    """A line a knob: seconds of a forward pass, and the mean error of its picture."""
    lines: dict[str, list[Point]] = {}
    for row in rows:
        if row.forward_wall and row.error_mean is not None and isfinite(row.error_mean):
            lines.setdefault(row.knob, []).append((row.forward_wall, row.error_mean))
    return lines


if __name__ == "__main__":
    run(renderer)
