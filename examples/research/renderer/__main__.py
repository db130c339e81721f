"""Measure the renderer's error against its run time: `python -m research.renderer`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.measure import PIECES, QUICK_PIECES
from research.command import Output, Points, Quick, collect, print_message, print_result, run
from research.renderer import folders
from research.renderer.measurements import comparison, read_measurements
from research.renderer.settings import KNOBS, parse_knobs
from research.renderer.sweep import SweepPlan
from research.renderer.workloads import standard_workloads

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
Compare = Annotated[
    Path | None,
    typer.Option("--compare", metavar="bench.jsonl", help="Print the ratios to an earlier run."),
]


def renderer(
    scenes: Scenes = None,
    out: Output = Path("out/bench"),
    points: Points = None,
    knobs: Knobs = None,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs; times are medians.")] = 5,
    quick: Quick = False,
    compare: Compare = None,
) -> None:
    """Vary one setting of the renderer at a time, on synthetic and given scenes.

    Writes bench.jsonl, bench.md and two plots; those of an earlier run are replaced.
    """
    names = tuple(KNOBS) if knobs is None else parse_knobs(knobs)
    plan = SweepPlan(names, runs, quick=quick, pieces=QUICK_PIECES if quick else PIECES)
    earlier = None if compare is None else read_measurements(compare)
    if points is None:
        print_message("the garden is left out: give its points with --points FILE or GSEDIT_GARDEN")
    workloads = standard_workloads(scenes or [], points, quick=quick)
    rows = collect(folders.sweep_to_folder(out, workloads, plan))
    print_message(f"{len(rows)} measurements are in {out}; look at {out / folders.IMAGE_PLOT}")
    if earlier is not None:
        print_result(comparison(rows, earlier))
    print_result(str(out / folders.SWEEP_TABLE))


if __name__ == "__main__":
    run(renderer)
