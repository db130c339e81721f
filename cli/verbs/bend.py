"""`gsedit bend`: bend a part of a scene by handles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError

from ..core.command import flag, shows
from ..options.numbers import numbers
from ..options.selection import (
    SelectionOptions,
    parse_region,
    parse_where,
    recorded_cameras,
)

if TYPE_CHECKING:
    from gsedit.objects.bending.operation import Bend, Grip, Pixel, Triple
    from gsedit.select.rules import Selection

Handles = Annotated[
    list[str] | None,
    flag(
        "--handle",
        "Take a place, a pixel of a view (or a point X,Y,Z), by DX,DY,DZ world units; with R all "
        "within R of it alike. Repeatable.",
        "VIEW:X,Y:DX,DY,DZ[:R]",
    ),
]
Holds = Annotated[
    list[str] | None,
    flag("--hold", "Hold a place where it is. Repeatable.", "VIEW:X,Y[:R]"),
]
Cage = Annotated[
    str | None,
    flag(
        "--cage",
        "Move nothing out of this region (as sphere:X,Y,Z,R) or expression of --where.",
        "REGION",
    ),
]


@shows(
    "--handle", "--hold", "--cage", "--where", "--region", "--data", "--output", "--force",
    "--dry-run",
)  # fmt: skip
def bend(
    handle: Handles = None,
    hold: Holds = None,
    cage: Cage = None,
    *,
    selection: SelectionOptions,
) -> Bend:
    """Bend a part of a scene by handles.

    gsedit bend bear.ply --region bear.npy --handle 0:16,95:0,-0.4,0:0.1 --hold 0:150,178:0.2
    -o up.ply

    What is between the handles follows as rigidly as possible; covariances and SH follow too.
    VIEW is a name or number of cameras.json beside the scene, X,Y a pixel of its picture.
    """
    from gsedit.objects.bending.operation import Bend, Pixel

    if not handle:
        raise UsageError("name what to move: --handle VIEW:X,Y:DX,DY,DZ")
    grips = (*map(handle_of, handle), *map(hold_of, hold or ()))
    asks = any(isinstance(grip.at, Pixel) for grip in grips)
    cameras = recorded_cameras("a pixel of a view", selection.data) if asks else None
    part = None if cage is None else cage_of(cage, selection.data)
    return Bend(grips, selection.selection(), part, cameras)


def handle_of(text: str) -> Grip:
    """Read PLACE:DX,DY,DZ or PLACE:DX,DY,DZ:R. Raises UsageError."""
    from gsedit.objects.bending.operation import Grip

    parts = text.split(":")
    radius = radius_of("--handle", parts.pop()) if "," not in parts[-1] else 0.0
    if len(parts) < 2:
        raise UsageError(f"--handle {text}: give VIEW:X,Y:DX,DY,DZ or X,Y,Z:DX,DY,DZ")
    x, y, z = numbers("--handle", parts.pop(), 3)
    return Grip(place_of("--handle", parts), (x, y, z), radius)


def hold_of(text: str) -> Grip:
    """Read PLACE or PLACE:R. Raises UsageError."""
    from gsedit.objects.bending.operation import Grip

    parts = text.split(":")
    radius = radius_of("--hold", parts.pop()) if "," not in parts[-1] else 0.0
    return Grip(place_of("--hold", parts), radius=radius)


def place_of(option: str, parts: list[str]) -> Pixel | Triple:
    """Read X,Y,Z, or VIEW and X,Y; the name of a view may hold colons. Raises UsageError."""
    from gsedit.objects.bending.operation import Pixel

    *view, last = parts or [""]
    if not view:
        x, y, z = numbers(option, last, 3)
        return x, y, z
    x, y = numbers(option, last, 2)
    return Pixel(":".join(view), x, y)


def radius_of(option: str, text: str) -> float:
    """Read a radius of 0 or more. Raises UsageError."""
    (radius,) = numbers(option, text, 1)
    if radius < 0:
        raise UsageError(f"{option}: a radius of {radius:g} is less than 0")
    return radius


def cage_of(text: str, data: Path | None) -> Selection:
    """Read a region or an expression. Raises UsageError."""
    try:
        return parse_region(text, data)
    except UsageError:
        return parse_where(text, data)
