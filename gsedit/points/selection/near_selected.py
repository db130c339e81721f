"""Selections that are grown or shrunk: by how far centres are from those of others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gsedit.files.shapes import Bool, Float32
from gsedit.files.table import SplatTable
from gsedit.points.selection.base import Selection
from gsedit.points.selection.volumes import check_positive


@dataclass(frozen=True)
class AtDistance(Selection):
    """A selection by distance from what `inner` selects."""

    verb: ClassVar[str]
    """For messages."""
    inner: Selection
    radius: float

    def __post_init__(self) -> None:
        check_positive(self.verb, "radius", self.radius)

    @property
    def whole(self) -> bool:
        return True

    @property
    def view_dependent(self) -> bool:
        return self.inner.view_dependent


@dataclass(frozen=True)
class Grown(AtDistance):
    """What `inner` selects, and what is at most `radius` from it."""

    verb: ClassVar[str] = "grow"

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        inside = self.inner.mask(table)
        return inside | _within(table.means, inside, self.radius)


@dataclass(frozen=True)
class Shrunk(AtDistance):
    """What `inner` selects, without what is at most `radius` from the rest."""

    verb: ClassVar[str] = "shrink"

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        inside = self.inner.mask(table)
        return inside & ~_within(table.means, ~inside, self.radius)


def _within(
    means: Float32[np.ndarray, "n 3"], sources: Bool[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Whether a row is no source, and at most `radius` from one."""
    from scipy.spatial import KDTree

    usable = np.isfinite(means).all(1)
    found = np.zeros(len(means), bool)
    given, asked = usable & sources, np.flatnonzero(usable & ~sources)
    if not given.any() or not len(asked):
        return found
    tree, points = KDTree(means[given]), means[asked]
    # far points are cheap to leave out, and most are far
    low, high = means[given].min(0) - radius, means[given].max(0) + radius
    near = ((points >= low) & (points <= high)).all(1)
    # query asks for distances below its bound: the next number includes the bound itself
    distance, _ = tree.query(
        points[near], distance_upper_bound=np.nextafter(radius, np.inf), workers=-1
    )
    found[asked[near]] = np.isfinite(distance)
    return found
