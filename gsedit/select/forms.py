"""Selections as functions of plain numbers and texts: what `where` calls, and the command line.

`where` reads the types of their parameters: see `ARGUMENTS` there. Coordinates and lengths are in
units of the scene; angles are degrees about x, then y, then z.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gsedit.select.clusters import Clusters, Grown, Shrunk
from gsedit.select.rules import EVERYTHING, Flags, Selection
from gsedit.select.seen import LEAST_PIXELS, InTheMiddle, Seen
from gsedit.select.values import (
    Amount,
    Column,
    Computed,
    Distance,
    NearColor,
    Ranked,
    Value,
    parse_color,
)
from gsedit.select.volumes import (
    InsideMesh,
    box,
    cylinder,
    ellipsoid,
    half_space,
    oriented_box,
    sphere,
)


def near(color: str, difference: float = 10.0) -> Selection:
    """Select colors that differ by at most `difference` (CIE Lab) from #rrggbb, or from a pixel
    given as `photo.jpg@COLUMN,ROW`."""
    return NearColor(parse_color(color), difference)


def flags(path: str) -> Selection:
    """Select by a .npy file of flags, such as `gsedit select` writes."""
    return Flags(Path(path).expanduser())


def largest(amount: Amount, value: Value) -> Selection:
    """The rows with the largest values: 1000 of them, or '10%'."""
    return Ranked(amount, value)


def smallest(amount: Amount, value: Value) -> Selection:
    """The rows with the smallest values: 1000 of them, or '10%'."""
    return Ranked(amount, value, largest=False)


def inside(mesh: str) -> Selection:
    """Select the inside of a closed mesh: .obj, .ply, .stl, .off or .glb."""
    return InsideMesh(Path(mesh).expanduser())


def cluster(n: int = 1, gap: float | None = None, of: Selection = EVERYTHING) -> Selection:
    """The n largest clusters: of centers linked by gaps of at most `gap`, among `of`."""
    return Clusters(n, gap, of)


def cluster_at(
    x: float, y: float, z: float, gap: float | None = None, of: Selection = EVERYTHING
) -> Selection:
    """The cluster of the center nearest to x,y,z."""
    return Clusters(1, gap, of, (x, y, z))


def grow(selection: Selection, radius: float) -> Selection:
    """A selection, and what is at most `radius` from it."""
    return Grown(selection, radius)


def shrink(selection: Selection, radius: float) -> Selection:
    """A selection, without what is at most `radius` from the rest."""
    return Shrunk(selection, radius)


def seen(cameras: str, pixels: float = LEAST_PIXELS) -> Selection:
    """Select Gaussians that contribute `pixels` or more to the pictures of a cameras.json or of
    posed photos."""
    return Seen(Path(cameras), pixels=pixels)


def middle(within: float, cameras: str) -> Selection:
    """Gaussians near the point that the cameras of a cameras.json or of posed photos look at.

    `within` is a multiple of the median distance of the cameras from that point.
    """
    return InTheMiddle(Path(cameras), within=within)


def everything() -> Selection:
    """Select every Gaussian of the scene."""
    return EVERYTHING


def distance(x: float, y: float, z: float) -> Value:
    """From x,y,z to the center."""
    return Distance((x, y, z))


def column(name: str) -> Value:
    """An extra column of the file."""
    return Column(name)


def absolute(value: Value) -> Value:
    """Absolute value of a number."""
    return Computed("abs", (value,))


SELECTIONS: dict[str, Callable[..., Selection]] = {
    **{
        form.__name__: form
        for form in (
            *(box, oriented_box, sphere, ellipsoid, cylinder, half_space, near, flags),
            *(largest, smallest, inside, cluster, cluster_at, grow, shrink, seen, middle),
        )
    },
    "all": everything,
}
"""By their names in expressions."""

VALUES: dict[str, Callable[..., Value]] = {
    "distance": distance,
    "column": column,
    "abs": absolute,
}
"""Functions that give a number a Gaussian, by their names in expressions."""
