"""What is no part of the captured scene, removed, each Gaussian for a reason that is told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from gsedit.files.streams import SceneHeader
from gsedit.files.table import SplatTable
from gsedit.points.operation import Say, Scene, Whole, apply, silent
from gsedit.points.survey import KEPT, REASONS, USUAL, Limits, survey

COLUMN = "defect"
"""The extra column of a marked scene."""


@dataclass(frozen=True)
class Clean(Whole):
    """Remove the Gaussians for which `survey` has a reason; a line is said for each reason."""

    removes: ClassVar[bool] = True
    limits: Limits = USUAL
    mark: bool = False
    """Remove nothing: write the number of the reason into the column `defect`."""
    reasons: Path | None = None
    """Where to write the number of the reason of every row, 0 for what stays, as .npy."""

    def header(self, header: SceneHeader) -> SceneHeader:
        if not self.mark:
            return header
        return header.replace(extra={**header.extra, COLUMN: np.dtype(np.uint8)})

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        why = survey(table, self.limits)
        counts = np.bincount(why, minlength=len(REASONS)).tolist()
        for number, (name, count) in enumerate(zip(REASONS, counts)):
            if count and number != KEPT:
                say(f"{count:,} {name}" + (f" ({COLUMN} {number})" if self.numbered else ""))
        if self.reasons is not None:
            write_reasons(self.reasons, why)
        if self.mark:
            return table.replace(extra={**table.extra, COLUMN: why})
        return table if counts[KEPT] == len(table) else table[why == KEPT]

    @property
    def numbered(self) -> bool:
        """Whether numbers of reasons are written somewhere."""
        return self.mark or self.reasons is not None


def clean(scene: Scene, limits: Limits = USUAL, say: Say = silent) -> Scene:
    """The scene without what is no part of it: see `survey`. `say` receives a line a reason."""
    return apply(scene, Clean(limits), say=say)


def write_reasons(path: Path, reasons: np.ndarray) -> None:
    """Write an array of reasons as .npy, whole or not at all."""
    from gsedit.files.atomic import atomic_path

    with atomic_path(path, overwrite=True) as temporary, temporary.open("wb") as handle:
        np.save(handle, reasons)
