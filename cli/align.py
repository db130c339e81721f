"""`gsedit align`: to the ground, to a known length, to another scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message
from .options import scene_file
from .selection_options import numbers

if TYPE_CHECKING:
    from gsedit.points.align import Align

    from .file_options import FileOptions

ToGround = Annotated[
    bool, typer.Option("--to-ground", help="Make the ground level, at 0 along the axis --up.")
]
Up = Annotated[str, typer.Option("--up", metavar="AXIS", help="Axis that points up afterwards.")]
UpNow = Annotated[
    str | None,
    typer.Option(
        "--up-now", metavar="AXIS", show_default=False,
        help="Axis that points up now, within 35 degrees. Default: guessed.",
    ),
]  # fmt: skip
To = Annotated[
    Path | None,
    typer.Option(
        "--to", metavar="OTHER", show_default=False,
        help="Lay the scene on another one of the same thing: turn, scale and move.",
    ),
]  # fmt: skip
Length = Annotated[
    str | None,
    typer.Option(
        "--length", metavar="X,Y,Z,X,Y,Z=LENGTH", show_default=False,
        help="Scale so that two points, in the scene's coordinates, are a known length apart.",
    ),
]  # fmt: skip
Save = Annotated[
    Path | None,
    typer.Option(
        "--save", metavar="FILE.json", show_default=False,
        help="Write the similarity too, for transform --matrix.",
    ),
]  # fmt: skip
Cameras = Annotated[
    bool,
    typer.Option("--cameras", help="Move the scene's cameras.json along, to OUTPUT.cameras.json."),
]


def align(
    to_ground: ToGround = False,
    up: Up = "-y",
    up_now: UpNow = None,
    to: To = None,
    length: Length = None,
    save: Save = None,
    cameras: Cameras = False,
    *,
    files: FileOptions,
) -> Align:
    """Bring a scene to its ground, to a known length, or onto another scene.

    gsedit align scene.ply --to-ground --up z -o level.ply

    gsedit align scan2.ply --to scan1.ply --save found.json -o laid.ply

    One of the three; chain them with then.
    """
    from gsedit.errors import UsageError

    asked = {"--to-ground": to_ground, "--to": to, "--length": length}
    chosen = [flag for flag, given in asked.items() if given]
    if len(chosen) != 1:
        given = " and ".join(chosen) or "nothing"
        raise UsageError(f"{given} was asked for: give one of --to-ground, --to, --length")
    if save is not None and save.suffix != ".json":
        raise UsageError(f"--save {save}: the similarity is written as .json")
    from gsedit.points import align as kinds

    more: Any = {"save": save, "cameras": cameras}
    if to_ground:
        return kinds.AlignToGround(up, up_now, **more)
    if to is not None:
        from gsedit.files.formats import open_scene

        other = open_scene(scene_file(to), files.read())
        for note in other.notes:
            print_message(f"{to}: {note}")
        return kinds.AlignTo(other.table(), **more)
    points, _, known = str(length).partition("=")
    ends = numbers("--length", points, 6)
    metres = numbers("--length", known, 1)[0]
    return kinds.AlignLength(ends[:3], ends[3:], metres, **more)
