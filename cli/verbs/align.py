"""`gsedit align`: to the ground, to a known length, to another scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

from ..core.command import option
from ..core.console import print_message
from ..options.common import scene_file
from ..options.numbers import numbers

if TYPE_CHECKING:
    from gsedit.toolkit.align import Align

    from ..options.files import FileOptions


@dataclass(frozen=True)
class AlignOptions:
    """Options of `gsedit align` alone."""

    to_ground: bool = option(False, "Make the ground level, at 0 along the axis --up.")
    up: str = option("-y", "Axis that points up afterwards.", "AXIS")
    up_now: str | None = option(
        None, "Axis that points up now, within 35 degrees. Default: guessed.", "AXIS"
    )
    to: Path | None = option(
        None, "Lay the scene on another one of the same thing: turn, scale and move.", "OTHER"
    )
    length: str | None = option(
        None,
        "Scale so that two points, in the scene's coordinates, are a known length apart.",
        "X,Y,Z,X,Y,Z=LENGTH",
    )
    save: Path | None = option(
        None, "Write the similarity too, for transform --matrix.", "FILE.json"
    )
    cameras: bool = option(False, "Move the scene's cameras.json along, to OUTPUT.cameras.json.")


def align(*, own: AlignOptions, files: FileOptions) -> Align:
    """Align a scene to its ground, a known length, or another scene.

    gsedit align scene.ply --to-ground --up z -o level.ply

    gsedit align scan2.ply --to scan1.ply --save found.json -o laid.ply

    Give one of --to-ground, --to and --length; chain several with then.
    """
    asked = {"--to-ground": own.to_ground, "--to": own.to, "--length": own.length}
    chosen = [flag for flag, given in asked.items() if given]
    if len(chosen) != 1:
        given = " and ".join(chosen) or "nothing"
        raise UsageError(f"{given} was asked for: give one of --to-ground, --to, --length")
    from gsedit.toolkit import align as kinds

    more: Any = {"save": own.save, "cameras": own.cameras}
    if own.to_ground:
        return kinds.AlignToGround(own.up, own.up_now, **more)
    if own.to is not None:
        from gsedit.formats.registry import open_scene

        other = open_scene(scene_file(own.to), files.read())
        for note in other.notes:
            print_message(f"{own.to}: {note}")
        return kinds.AlignTo(other.table(), **more)
    points, _, known = str(own.length).partition("=")
    ends = numbers("--length", points, 6)
    metres = numbers("--length", known, 1)[0]
    return kinds.AlignLength(ends[:3], ends[3:], metres, **more)
