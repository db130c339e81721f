"""Verbs that move Gaussians, by the operation that each returns: transform, align."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from gsedit.errors import UsageError

from ..core.command import option, shows
from ..core.console import print_message
from ..options.common import FileOptions, numbers, scene_file
from ..options.selection import SelectionOptions

if TYPE_CHECKING:
    from gsedit.toolkit.align import Align
    from gsedit.toolkit.transform import Transform

_PLACES = count()


class Step(str):
    """The text of an option, with its place among those of the command line."""

    place: int


def _placed(value: list[str] | None) -> list[Step] | None:
    """typer calls this for the options in the order of the command line."""
    if not value:
        return None
    if len(value) > 1:
        raise typer.BadParameter("given twice: chain the second with then, as in then transform")
    step = Step(value[0])
    step.place = next(_PLACES)
    return [step]


@dataclass(frozen=True)
class Steps:
    """Moves of `gsedit transform`, done in the order of the command line."""

    translate: list[str] | None = option(None, "X,Y,Z", callback=_placed)
    """Move, in world units."""
    rotate: list[str] | None = option(None, "X,Y,Z", callback=_placed)
    """Turn by degrees about the fixed axes: x first, then y, z."""
    rotate_axis: list[str] | None = option(None, "AX,AY,AZ,DEG", flags=None, callback=_placed)
    """Turn by degrees about an axis, right-handed: AX,AY,AZ,DEG."""
    quat: list[str] | None = option(None, "W,X,Y,Z", callback=_placed)
    """Turn by a quaternion: W,X,Y,Z."""
    scale: list[str] | None = option(None, "FACTOR", callback=_placed)
    """Scale all axes alike."""
    mirror: list[str] | None = option(None, "x|y|z", callback=_placed)
    """Change the sign of one axis."""
    up: list[str] | None = option(None, "FROM,TO", callback=_placed)
    """Turn so that what is up, as z, becomes another axis, as -y."""
    matrix: list[str] | None = option(None, "FILE", callback=_placed)
    """Apply a 4x4 matrix: .json (as --save writes), .npy, or text."""

    def in_order(self) -> list[tuple[str, str]]:
        """Return the name and the text of the steps that were given, in their order."""
        given = [(name, texts[0]) for name, texts in vars(self).items() if texts]
        return sorted(given, key=lambda pair: getattr(pair[1], "place", 0))


@dataclass(frozen=True)
class TransformOptions:
    """Options of `gsedit transform` alone."""

    pivot: str | None = option(None, "X,Y,Z|center")
    """Point to turn, scale and mirror about. None: the origin."""
    center: bool = option(False, flags=None)
    """First move the median of the centers to the origin."""
    inverse: bool = option(False)
    """Do the inverse of all steps together."""
    copy: bool = option(False)
    """Keep the originals too: duplicate."""
    cameras: bool = option(False)
    """Move the scene's cameras.json along, to OUTPUT.cameras.json."""


@shows(
    "--translate", "--rotate", "--scale", "--mirror", "--up", "--copy",
    "--cameras", "--where", "--region", "--output", "--force", "--dry-run",
)  # fmt: skip
def transform(*, steps: Steps, own: TransformOptions, selection: SelectionOptions) -> Transform:
    """Move, turn, scale or mirror a scene or a part of it.

    gsedit transform scene.ply --up z,-y --scale 2 --translate 0,1,0 -o moved.ply

    Steps run in the order of the command line. Covariances and SH follow exactly.
    """
    from gsedit.toolkit.transform import compose, transform_of

    given = steps.in_order()
    if not given and not own.center and not own.copy:
        raise UsageError("name what to do: --translate, --rotate, --scale, --mirror, --up, ...")
    whole = compose((name, _value(name, text)) for name, text in given)
    if own.inverse:
        whole = whole.inverse
    pivot = own.pivot
    point = pivot if pivot in (None, "center") else numbers("--pivot", str(pivot), 3)
    how = {"center": own.center, "copy": own.copy, "cameras": own.cameras}
    return transform_of(whole, pivot=point, selection=selection.selection(), **how)


def _value(name: str, text: str) -> Any:
    """Return the value of a step from the text of its option."""
    flag = f"--{name.replace('_', '-')}"
    counts = {"translate": 3, "rotate": 3, "rotate_axis": 4, "quat": 4}
    if name in counts:
        return numbers(flag, text, counts[name])
    if name == "scale":
        return numbers(flag, text, 1)[0]
    if name == "up":
        return text.split(",")
    if name == "matrix":
        from gsedit.toolkit.transform import read_similarity

        return read_similarity(Path(text)).matrix
    return text


@dataclass(frozen=True)
class AlignOptions:
    """Options of `gsedit align` alone."""

    to_ground: bool = option(False)
    """Make the ground level, at 0 along the axis --up."""
    up: str = option("-y", "AXIS")
    """Axis that points up afterwards."""
    up_now: str | None = option(None, "AXIS")
    """Axis that points up now, within 35 degrees. None: guessed."""
    to: Path | None = option(None, "OTHER")
    """Lay the scene on another one of the same thing: turn, scale and move."""
    length: str | None = option(None, "X,Y,Z,X,Y,Z=LENGTH")
    """Scale so that two points, in the scene's coordinates, are a known length apart."""
    save: Path | None = option(None, "FILE.json")
    """Write the similarity too, for transform --matrix."""
    cameras: bool = option(False)
    """Move the scene's cameras.json along, to OUTPUT.cameras.json."""


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
        from gsedit.formats.files import open_scene

        other = open_scene(scene_file(own.to), files.read())
        for note in other.notes:
            print_message(f"{own.to}: {note}")
        return kinds.AlignTo(other.table(), **more)
    points, _, known = str(own.length).partition("=")
    ends = numbers("--length", points, 6)
    metres = numbers("--length", known, 1)[0]
    return kinds.AlignLength(ends[:3], ends[3:], metres, **more)
