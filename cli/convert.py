"""`gsedit convert`: the same scene in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .operations import Target

Out = Annotated[
    Path | None,
    typer.Argument(
        metavar="OUT",
        show_default=False,
        help="Scene to write; its suffix is the format. May be given as -o OUT.",
    ),
]


def convert(target: Out = None) -> Target:
    """Write a scene in another format: the suffix of OUT says which.

    What that format cannot hold is named in one line.

    gsedit convert scene.ply scene.spz
    """
    return Target(target)
