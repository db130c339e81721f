"""Short forms of expressions, for people: regions, and pixels of views. Loads no numpy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from gsedit.errors import UsageError

FORMS = (
    "auto, all, box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, a .png file, a folder, or an "
    "expression, as in thing('the red one')"
)
NUMBERS = {"box": 6, "sphere": 4}
"""Numbers of the volumes that have a short form."""
OUTSIDE = "not:"
"""Prefix of the view of a click that is not on the object."""
PLACE = re.compile(r"(?P<out>not:)?(?P<view>.+):(?P<x>\d+(\.\d*)?),(?P<y>\d+(\.\d*)?)")
"""A pixel of a view, for a person: [not:]VIEW:X,Y."""


def expression_of(region: str) -> str:
    """The expression that a short form means; another text is an expression already.

    Raises UsageError for a volume without its numbers.
    """
    if region in ("auto", "all"):
        return "subject()" if region == "auto" else "all()"
    shape, colon, rest = region.partition(":")
    if colon and shape in NUMBERS:
        return _volume(region, shape, rest)
    path = Path(region).expanduser()
    if path.suffix.lower() == ".npy":
        return f"flags({quoted(region)})"
    if path.suffix.lower() == ".png" or (region and path.is_dir()):
        return f"mask({quoted(region)})"
    return region


def _volume(region: str, shape: str, rest: str) -> str:
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != NUMBERS[shape] or not all(map(isfinite, numbers)):
        form = next(form for form in FORMS.split(", ") if form.startswith(shape))
        raise UsageError(f"region {region}: give {NUMBERS[shape]} finite numbers, as in {form}")
    if shape == "box":
        numbers = [choose(p) for choose in (min, max) for p in zip(numbers[:3], numbers[3:])]
    return f"{shape}({', '.join(map(repr, numbers))})"


def expression_of_clicks(places: Sequence[str]) -> str:
    """The expression of pixels as a person writes them, [not:]VIEW:X,Y. Raises UsageError."""
    told = (place_of(text) for text in places)
    return f"click({', '.join(f'{quoted(view)}, {x:g}, {y:g}' for view, x, y in told)})"


def place_of(text: str) -> tuple[str, float, float]:
    """The view, with OUTSIDE before it where the text has that, the column and the row of a pixel
    as a person writes it. Raises UsageError."""
    place = PLACE.fullmatch(text.strip())
    if place is None:
        raise UsageError(
            f"--at {text}: give a view, a column and a row, as in --at frame_00012.jpg:130,80, or "
            "not:... for a place that is not on it"
        )
    return (place["out"] or "") + place["view"], float(place["x"]), float(place["y"])


def quoted(text: str) -> str:
    """A text in the quotes of an expression, which has no escapes."""
    mark = '"' if "'" in text else "'"
    return mark + text.replace(mark, " ") + mark
