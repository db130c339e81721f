"""Repeat the experiments of Efficient-NeRF2NeRF: `python -m research.paper`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from gsedit.errors import UsageError
from research.command import Data, Output, Quick, collect, print_message, print_result, run
from research.paper import folder
from research.paper.studies import FULL, QUICK, capture_case, missing_strategies, studies

Capture = Annotated[
    Path | None,
    typer.Argument(
        metavar="SCENE", show_default=False, help="A fitted capture (.ply) to edit as well."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs", min=1, show_default="one a core", help="Runs at once, of one thread each."
    ),
]
Page = Annotated[
    Path | None,
    typer.Option(
        "--write-docs",
        metavar="PAGE.md",
        show_default=False,
        help="Replace the tables of this page, between its markers.",
    ),
]


def paper(
    scene: Capture = None,
    data: Data = None,
    out: Output = Path("out/paper"),
    jobs: Jobs = None,
    docs: Page = None,
    quick: Quick = False,
) -> None:
    """Compare strategies, consensus and losses by their error to an exact edit.

    Writes report.html, summary.json, tables.md, plots, and the runs. A run whose file is there is
    not repeated: an interrupted experiment goes on.
    """
    if docs is not None and not docs.is_file():
        raise UsageError(f"--write-docs {docs} is not there: name the page whose tables to replace")
    size = QUICK if quick else FULL
    skipped = [] if scene and scene.exists() else [f"The capture is left out: {no_capture(scene)}."]
    capture = None if skipped else capture_case(str(scene), str(data or ""), size)
    if missing := missing_strategies():
        skipped.append(f"Strategies that are not there: {', '.join(missing)}.")
    for sentence in skipped:
        print_message(sentence)
    parts, at_once = studies(size, capture), jobs or os.cpu_count() or 1
    items = folder.paper_to_folder(out, size, parts, jobs=at_once, skipped=" ".join(skipped))
    collect(items)
    if docs is not None:
        folder.write_docs(docs, out)
    print_result(str(out / folder.REPORT))


def no_capture(scene: Path | None) -> str:
    """Why no capture is edited."""
    if scene is None:
        return "name a fitted scene, as in python -m research.paper bear.ply --data photos/"
    return f"{scene} is not there"


if __name__ == "__main__":
    run(paper)
