"""Selections: rules that tell of every Gaussian whether it is selected.

Selections combine: `a & b` (both), `a | b` (either), `~a` (not).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

import numpy as np

from gsedit.formats.flags import read_flags
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable

QUIET = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""For masks that compute: a damaged row is not selected, and no reason for a warning."""


@dataclass(frozen=True)
class Selection(ABC):
    """A rule that selects Gaussians of a scene."""

    @property
    def whole(self) -> bool:
        """Whether `mask` must be given all rows of the scene at once, in the order of its file."""
        return False

    @property
    def view_dependent(self) -> bool:
        """Whether `mask` looks at the bands of SH above the first."""
        return False

    @abstractmethod
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        """Whether each row is selected. Does not write into the arrays of `table`.

        A row with NaN where the rule looks is not selected by it, so its complement selects it.
        Raises UsageError for a column that the scene lacks, InputError for a file that does not
        fit.
        """

    def __and__(self, other: Selection) -> Selection:
        return Intersection((self, other))

    def __or__(self, other: Selection) -> Selection:
        return Union((self, other))

    def __invert__(self) -> Selection:
        return Complement((self,))


@dataclass(frozen=True)
class Everything(Selection):
    """Select every Gaussian of the scene."""

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return np.ones(len(table), bool)


EVERYTHING = Everything()


@dataclass(frozen=True)
class Combined(Selection):
    """A selection that asks others: it needs what they need."""

    parts: tuple[Selection, ...]

    @property
    def whole(self) -> bool:
        return any(part.whole for part in self.parts)

    @property
    def view_dependent(self) -> bool:
        return any(part.view_dependent for part in self.parts)


@dataclass(frozen=True)
class Intersection(Combined):
    """Select the Gaussians that all parts select."""

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return np.logical_and.reduce([part.mask(table) for part in self.parts])


@dataclass(frozen=True)
class Union(Combined):
    """Select the Gaussians that at least one part selects."""

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return np.logical_or.reduce([part.mask(table) for part in self.parts])


@dataclass(frozen=True)
class Complement(Combined):
    """Select the Gaussians that the only part does not select."""

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        (inner,) = self.parts
        return ~inner.mask(table)


@dataclass(frozen=True)
class WholeSelection(Selection):
    """A selection whose `mask` must be given all rows of the scene at once."""

    @property
    def whole(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class Given(WholeSelection):
    """Flags that are known already, one for each row."""

    flags: Bool[np.ndarray, " n"]

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return self.flags


@dataclass(frozen=True)
class Flags(WholeSelection):
    """The flags of a file, one for each Gaussian of the scene."""

    path: Path

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return read_flags(self.path, len(table))


def saved_flags(asked: object) -> Iterator[Flags]:
    """The saved flags that an operation or a selection asks, in its fields and theirs."""
    if isinstance(asked, Flags):
        yield asked
    elif isinstance(asked, tuple):
        for each in asked:
            yield from saved_flags(each)
    elif is_dataclass(asked) and not isinstance(asked, type):
        for field in fields(asked):
            yield from saved_flags(getattr(asked, field.name))
