"""A region as it is written on the command line: all, auto, a box, a sphere, or a file."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from torch import Tensor

Point = tuple[float, float, float]
FORMS = "all, auto, box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, a .png file or a folder"


@dataclass(frozen=True)
class All:
    """Every Gaussian."""


@dataclass(frozen=True)
class Auto:
    """The subject, as the 2D editor sees it; everything where the instruction is about the scene"""


@dataclass(frozen=True)
class Box:
    """Along the axes of the scene's file, in its units."""

    low: Point
    high: Point

    def contains(self, points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Whether each point is inside; the faces are."""
        low, high = points.new_tensor(self.low), points.new_tensor(self.high)
        return ((points >= low) & (points <= high)).all(-1)


@dataclass(frozen=True)
class Sphere:
    """In the coordinates and units of the scene's file."""

    centre: Point
    radius: float

    def contains(self, points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Whether each point is inside; the surface is."""
        return (points - points.new_tensor(self.centre)).norm(dim=-1) <= self.radius


@dataclass(frozen=True)
class File:
    """Flags in a .npy file, a mask drawn on a photo (.png), or a folder of such masks."""

    path: Path


RegionSpec = All | Auto | Box | Sphere | File


def parse_region(text: str) -> RegionSpec:
    """What `--region` says. Files are not read. Raises UsageError for anything else."""
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
