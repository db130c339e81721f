"""`gsedit merge`: several scenes as one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..core.command import argument
from ..options.common import scene_file

if TYPE_CHECKING:
    from gsedit.toolkit.merge import Merge

    from ..core.process import Output
    from ..options.files import FileOptions

Others = Annotated[list[Path], argument("OTHER...", "Scenes to add, in any format.")]


def merge(others: Others, *, files: FileOptions, output: Output) -> Merge:
    """Join several scenes into one file.

    gsedit merge room.ply chair.spz -o both.ply

    Rows keep their order. The result has the highest SH degree and all columns.
    """
    from gsedit.formats.registry import open_scene
    from gsedit.toolkit.merge import Merge

    sources = tuple(open_scene(scene_file(each), files.read()) for each in others)
    return Merge(sources, output.drop_invalid)
