"""Selections: rules that tell of every Gaussian of a scene whether it is meant, and join."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable

Flags = Bool[np.ndarray, " n"]
QUIET = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""For masks that compute: a damaged row is not selected, and no reason for a warning."""


@dataclass(frozen=True, eq=False)
class Selection:
    """A rule that selects Gaussians of a scene; `a & b`, `a | b` and `~a` make others of it."""

    mask: Callable[[SplatTable], Flags]
    """Tells whether each row is selected, and does not write into the arrays of the table.

    A row with NaN where the rule looks is not selected by it, so its complement selects it. Raises
    UsageError for a column that the scene lacks, InputError for a file that does not fit."""
    whole: bool = False
    """Whether `mask` must be given all rows of the scene at once, in the order of its file."""
    view_dependent: bool = False
    """Whether `mask` looks at the bands of SH above the first."""
    files: tuple[Path, ...] = ()
    """Files of saved flags that it reads."""
    question: Callable[[Any], Any] | None = None
    """Asks a `gsedit.select.finder.Finder` for a Region, where a scene has to be looked at."""

    def __and__(self, other: Selection) -> Selection:
        return combined(np.logical_and.reduce, self, other)

    def __or__(self, other: Selection) -> Selection:
        return combined(np.logical_or.reduce, self, other)

    def __invert__(self) -> Selection:
        return combined(lambda masks: ~masks[0], self)


def combined(join: Callable[[list[Flags]], Flags], *parts: Selection) -> Selection:
    """A selection of the masks of others, that needs what they need."""
    return Selection(
        lambda table: join([part.mask(table) for part in parts]),
        any(part.whole for part in parts),
        any(part.view_dependent for part in parts),
        tuple(file for part in parts for file in part.files),
    )


def given(inside: Flags) -> Selection:
    """The selection of flags that are known already, one for each row."""
    return Selection(lambda table: inside, whole=True)


def saved_flags(asked: object) -> Iterator[Path]:
    """The files of saved flags that an operation or a selection asks, in its fields and theirs."""
    if isinstance(asked, Selection):
        yield from asked.files
    elif isinstance(asked, tuple):
        for each in asked:
            yield from saved_flags(each)
    elif is_dataclass(asked) and not isinstance(asked, type):
        for field in fields(asked):
            yield from saved_flags(getattr(asked, field.name))


EVERYTHING = Selection(lambda table: np.ones(len(table), bool))
