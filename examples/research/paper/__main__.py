"""Repeat the experiments of Efficient-NeRF2NeRF: `python -m research.paper`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gsedit.errors import UsageError
from research.command import Output, Quick, collect, print_message, print_result, run
from research.paper import folder
from research.paper.cases import captured
from research.paper.runs import Case
from research.paper.studies import FULL, QUICK, studies

Captures = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="SCENE...", show_default=False, help="Fitted captures (.ply) to edit as well."
    ),
]
Photos = Annotated[
    list[Path] | None,
    typer.Option("--data", show_default=False, help="Photos of each capture, in their order."),
]
Jobs = Annotated[int, typer.Option("--jobs", min=1, help="Runs at once, of one thread each.")]
Report = Annotated[bool, typer.Option("--report", help="Run nothing; report what is there.")]


def paper(
    scenes: Captures = None,
    data: Photos = None,
    out: Output = Path("out/paper"),
    jobs: Jobs = 2,
    only_report: Report = False,
    quick: Quick = False,
) -> None:
    """Compare the method as printed, each of its parts, and gsedit's, by their errors.

    Writes report.md, summary.json, and the runs. A run whose file is there is
    not repeated: an interrupted experiment goes on. The report is of whatever was run.
    """
    size = QUICK if quick else FULL
    parts = studies(size, cases_of(scenes or [], data or [], size.pixels))
    if not only_report:
        if not scenes:
            print_message("no capture: name fitted scenes, as bear.ply --data photos/")
        collect(folder.run_all(out, parts, jobs=jobs))
    folder.write_results(out, size, parts)
    print_result(str(out / folder.REPORT))


def cases_of(scenes: Sequence[Path], data: Sequence[Path], pixels: int) -> list[Case]:
    """The captures with their photos. Raises UsageError for one that is not there."""
    for path in (*scenes, *data):
        if not path.exists():
            raise UsageError(f"{path} is not there: name a fitted scene, and the folder of photos")
    if len(data) > len(scenes):
        raise UsageError("--data is given more often than scenes: one folder a scene")
    photos = [*data, *[None] * (len(scenes) - len(data))]
    return [captured(scene, folder, pixels) for scene, folder in zip(scenes, photos)]


if __name__ == "__main__":
    run(paper)
