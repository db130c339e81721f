"""Measure edits of a scene with more and more Gaussians: `python -m research.scale`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from gsedit.errors import UsageError
from research.command import Data, Output, collect, print_result, require_new, run
from research.scale import measure


def scale(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", show_default=False, help="A fitted scene (.ply).")
    ],
    data: Data = None,
    out: Output = Path("out/scale"),
    gaussians: Annotated[
        str,
        typer.Option(metavar="N,N,...", help="About how many Gaussians: each is divided."),
    ] = "130000,1920000",
    degree: Annotated[
        int, typer.Option("--sh-degree", min=0, max=3, help="SH degree of the scenes made.")
    ] = 3,
    instruction: Annotated[str, typer.Option(help="Instruction.")] = "turn it into a bronze statue",
    options: Annotated[str, typer.Option(help="Further options of gsedit edit, in quotes.")] = "",
) -> None:
    """Measure seconds, memory and error of edits against the number of Gaussians.

    Writes scale.jsonl, scale.md and the edits. The edits run one after the other, each in a process
    of its own; the scenes are removed.
    """
    require_new(out)
    if data is None:
        raise UsageError("the edits are of captured views: name their folder with --data")
    if not all(number.strip().isdigit() for number in gaussians.split(",")):
        raise UsageError(f"--gaussians {gaussians} is no list of numbers, as in 130000,1920000")
    sizes = tuple(int(number) for number in gaussians.split(","))
    settings = measure.ScaleSettings(
        scene, data, instruction, sizes, degree, options=tuple(shlex.split(options))
    )
    print_result(measure.table(collect(measure.scale_to_folder(out, settings))))


if __name__ == "__main__":
    run(scale)
