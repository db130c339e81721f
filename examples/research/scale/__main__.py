"""Measure edits of a large scene, and of copies of it: `python -m research.scale`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gsedit.errors import UsageError
from research.command import Data, Output, collect, print_result, require_new, run
from research.scale import measure

SMALL = "'turn it into a bronze statue' --editor small"
EDITS = (SMALL, f"{SMALL} --disable merging", "'make it gold'", "'remove the bear'")
"""A look that `small` paints, and again with every Gaussian alone; a material; a removal."""


def scale(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", show_default=False, help="A fitted scene (.ply).")
    ],
    data: Data = None,
    out: Output = Path("out/scale"),
    copies: Annotated[
        str, typer.Option(metavar="N,N,...", help="How many of the scene stand side by side.")
    ] = "1,4",
    edits: Annotated[
        list[str] | None,
        typer.Option(
            "--edit",
            metavar="WORDS",
            show_default=False,
            help="Words of gsedit edit behind the scene; repeatable.",
        ),
    ] = None,
) -> None:
    """Measure seconds, memory and error of edits of a scene, and of copies of it side by side.

    Writes scale.jsonl, scale.md, the scenes and the edits. The edits run one after the other, each
    in a process of its own.
    """
    require_new(out)
    if data is None:
        raise UsageError("the edits are of captured views: name their folder with --data")
    if not all(number.strip().isdigit() for number in copies.split(",")):
        raise UsageError(f"--copies {copies} is no list of numbers, as in 1,4")
    numbers = tuple(int(number) for number in copies.split(","))
    settings = measure.ScaleSettings(scene, data, tuple(edits or EDITS), numbers)
    print_result(measure.table(collect(measure.scale_to_folder(out, settings))))


if __name__ == "__main__":
    run(scale)
