"""Selections that are grown or shrunk: by how far centers are from those of others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gsedit.scene.neighbors import k_nearest
from gsedit.scene.shapes import Bool, Float32
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.base import Selection, WholeSelection
from gsedit.toolkit.selection.volumes import check_positive


@dataclass(frozen=True)
class AtDistance(WholeSelection):
    """A selection by distance from what `inner` selects."""

    verb: ClassVar[str]
    """Verb that messages use for this selection."""
    inner: Selection
    radius: float

    def __post_init__(self) -> None:
        check_positive(self.verb, "radius", self.radius)

    @property
    def view_dependent(self) -> bool:
        return self.inner.view_dependent


@dataclass(frozen=True)
class Grown(AtDistance):
    """Select `inner` and everything at most `radius` away from it."""

    verb: ClassVar[str] = "grow"

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        inside = self.inner.mask(table)
        return inside | _within(table.means, inside, self.radius)


@dataclass(frozen=True)
class Shrunk(AtDistance):
    """Select `inner` without what is at most `radius` away from the rest."""

    verb: ClassVar[str] = "shrink"

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        inside = self.inner.mask(table)
        return inside & ~_within(table.means, ~inside, self.radius)


def _within(
    means: Float32[np.ndarray, "n 3"], sources: Bool[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Whether a row is no source, and at most `radius` from one."""
    usable = np.isfinite(means).all(1)
    found = np.zeros(len(means), bool)
    given, asked = usable & sources, np.flatnonzero(usable & ~sources)
    if not given.any() or not len(asked):
        return found
    points = means[asked]
    # far points are cheap to leave out, and most are far
    low, high = means[given].min(0) - radius, means[given].max(0) + radius
    near = ((points >= low) & (points <= high)).all(1)
    # query asks for distances below its bound: the next number includes the bound itself
    distance, _ = k_nearest(means[given], points[near], 1, bound=np.nextafter(radius, np.inf))
    found[asked[near]] = np.isfinite(distance[:, 0])
    return found
