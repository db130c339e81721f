"""`gsedit merge`: several scenes as one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import scene_file

if TYPE_CHECKING:
    from gsedit.points.merge import Merge

    from .file_options import FileOptions
    from .operations import Output

Others = Annotated[
    list[Path],
    typer.Argument(metavar="OTHER...", help="Scenes to add, in any format.", show_default=False),
]


def merge(others: Others, *, files: FileOptions, output: Output) -> Merge:
    """Join scenes into one file: rows in order, SH of the highest degree, all columns.

    gsedit merge room.ply chair.spz -o both.ply
    """
    from gsedit.files.formats import open_scene
    from gsedit.points.merge import Merge

    sources = tuple(open_scene(scene_file(each), files.read()) for each in others)
    return Merge(sources, output.drop_invalid)
