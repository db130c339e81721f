"""Repeat the experiments of Efficient-NeRF2NeRF: `python -m research.paper`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gsedit.errors import UsageError
from research.command import Output, Quick, collect, print_message, print_result, run
from research.paper import folder
from research.paper.cases import captured
from research.paper.costs import real_seconds
from research.paper.runs import Case
from research.paper.studies import FULL, QUICK, Study, estimate, studies

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
Page = Annotated[
    Path | None,
    typer.Option(
        "--write-docs",
        metavar="PAGE.md",
        show_default=False,
        help="Replace the tables of this page, between its markers.",
    ),
]
ClipFolder = Annotated[
    Path | None, typer.Option("--clip", help="Folder of CLIP's weights, for its similarity.")
]
EditorCost = Annotated[
    Path | None,
    typer.Option("--editor-cost", help="Results file of research.study_editor_cost."),
]
Only = Annotated[list[str] | None, typer.Option("--study", help="Run these alone; repeatable.")]
Estimate = Annotated[bool, typer.Option("--estimate", help="Print the plan and its cost.")]
Report = Annotated[bool, typer.Option("--report", help="Run nothing; report what is there.")]


def paper(
    scenes: Captures = None,
    data: Photos = None,
    out: Output = Path("out/paper"),
    jobs: Jobs = 2,
    docs: Page = None,
    clip: ClipFolder = None,
    cost: EditorCost = None,
    only: Only = None,
    only_estimate: Estimate = False,
    only_report: Report = False,
    quick: Quick = False,
) -> None:
    """Compare the method as printed, each of its parts, and gsedit's, by their errors.

    Writes report.md, summary.json, plots, and the runs. A run whose file is there is
    not repeated: an interrupted experiment goes on. The report is of whatever was run.
    """
    if docs is not None and not docs.is_file():
        raise UsageError(f"--write-docs {docs} is not there: name the page whose tables to replace")
    size = QUICK if quick else FULL
    parts = studies(size, cases_of(scenes or [], data or [], size.pixels))
    chosen = chosen_of(parts, only or [])
    if only_estimate:
        print_result(estimate(chosen, folder.read_records(out, chosen)[0]))
        return
    real = real_seconds(cost)
    if not only_report:
        if not scenes:
            print_message("no capture: name fitted scenes, as bear.ply --data photos/")
        collect(folder.run_all(out, chosen, jobs=jobs, clip=clip))
    folder.write_results(out, size, parts, real)
    if docs is not None:
        folder.write_docs(docs, out)
    print_result(str(out / folder.REPORT))


def cases_of(scenes: Sequence[Path], data: Sequence[Path], pixels: int) -> list[Case]:
    """The captures with their photos. Raises UsageError for one that is not there."""
    for path in (*scenes, *data):
        if not path.exists():
            raise UsageError(f"{path} is not there: name a fitted scene, and the folder of photos")
    if len(data) > len(scenes):
        raise UsageError("--data is given more often than scenes: one folder a scene")
    photos = [*data, *[None] * (len(scenes) - len(data))]
    cases = [captured(scene, folder, pixels) for scene, folder in zip(scenes, photos)]
    names = [case.name for case in cases]
    return [
        replace(case, name=f"{case.name}{k}") if names.count(case.name) > 1 else case
        for k, case in enumerate(cases)
    ]


def chosen_of(parts: Sequence[Study], only: Sequence[str]) -> list[Study]:
    """The studies of these names, or all. Raises UsageError."""
    names = [study.name for study in parts]
    if unknown := set(only) - set(names):
        raise UsageError(f"--study {unknown.pop()}: there are {', '.join(names)}")
    return [study for study in parts if not only or study.name in only]


if __name__ == "__main__":
    run(paper)
