"""Selections that were saved: a .npy file of flags, as `gsedit select` and `edit` write it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsedit.files.flags import read_flags
from gsedit.files.shapes import Bool
from gsedit.files.table import SplatTable
from gsedit.points.selection.base import Selection


@dataclass(frozen=True)
class Flags(Selection):
    """The flags of a file, one for each Gaussian of the scene."""

    path: Path

    @property
    def whole(self) -> bool:
        return True

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return read_flags(self.path, len(table))
