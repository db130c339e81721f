"""A region as it is written on the command line: all, auto, a box, a sphere, or a file."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Bool, Float

Point = tuple[float, float, float]
FORMS = "all, auto, box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, a .png file or a folder"


@dataclass(frozen=True)
class All:
    """The region of every Gaussian."""


@dataclass(frozen=True)
class Auto:
    """The region of the subject as the 2D editor sees it; all, if the instruction is about all."""


@dataclass(frozen=True)
class Box:
    """A box along the axes of the scene's file, in its units."""

    low: Point
    high: Point

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points inside; the faces are."""
        from gsedit.scene.volumes import inside_box

        return inside_box(points, self.low, self.high)


@dataclass(frozen=True)
class Sphere:
    """A sphere in the coordinates and units of the scene's file."""

    center: Point
    radius: float

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points inside; the surface is."""
        from gsedit.scene.volumes import inside_ball

        return inside_ball(points, self.center, self.radius)


@dataclass(frozen=True)
class File:
    """Flags in a .npy file, a mask drawn on a photo (.png), or a folder of such masks."""

    path: Path


RegionSpec = All | Auto | Box | Sphere | File


def parse_region(text: str) -> RegionSpec:
    """Parse a `--region`; files are not read. Raises UsageError for what is none."""
    if text in ("all", "auto"):
        return All() if text == "all" else Auto()
    shape, colon, rest = text.partition(":")
    if colon and shape == "box":
        x = _numbers(text, rest, 6)
        pairs = list(zip(x[:3], x[3:]))
        low, high = (tuple(choose(pair) for pair in pairs) for choose in (min, max))
        return Box(low, high)  # type: ignore[arg-type]
    if colon and shape == "sphere":
        x, y, z, radius = _numbers(text, rest, 4)
        if radius <= 0:
            raise UsageError(f"region {text}: the radius must be more than 0")
        return Sphere((x, y, z), radius)
    path = Path(text).expanduser()
    if path.suffix.lower() in (".npy", ".png") or (text and path.is_dir()):
        return File(path)
    raise UsageError(f"region {text!r} is none that can be used: give {FORMS}")


def _numbers(text: str, rest: str, count: int) -> list[float]:
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(isfinite, numbers)):
        form = next(form for form in FORMS.split(", ") if form.startswith(text.partition(":")[0]))
        raise UsageError(f"region {text}: give {count} finite numbers, as in {form}")
    return numbers
