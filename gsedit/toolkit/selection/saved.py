"""Selections that were saved: a .npy file of flags, as `gsedit select` and `edit` write it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

import numpy as np

from gsedit.formats.flags import read_flags
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.base import WholeSelection


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
