"""`gsedit convert`: the same scene in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

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


Undo = Annotated[
    Path | None,
    typer.Option(
        "--undo-dataparser", metavar="JSON", show_default=False,
        help="Bring a splat that nerfstudio exported back into the frame that COLMAP gave its "
        "photos: its dataparser_transforms.json.",
    ),
]  # fmt: skip


def convert(target: Out = None, undo_dataparser: Undo = None) -> list[Any]:
    """Write a scene in another format: the suffix of OUT says which.

    What that format cannot hold is named in one line. A mesh or a point cloud becomes Gaussians.

    gsedit convert scene.ply scene.spz
    """
    if undo_dataparser is None:
        return [Target(target)]
    from gsedit.files.dataparser import NAME, read_dataparser
    from gsedit.points.transform import transform_of

    return [transform_of(read_dataparser(undo_dataparser).inverse), Target(target, NAME)]
