"""What is no part of the captured scene, removed, each Gaussian for a reason that is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import UInt8

from gsedit.files.streams import SceneHeader
from gsedit.files.table import SplatTable
from gsedit.points.defects import UNSEEN
from gsedit.points.filter import as_selection
from gsedit.points.operation import Say, Scene, Whole, apply, silent
from gsedit.points.selection.base import Selection
from gsedit.points.survey import KEPT, REASONS, USUAL, Limits, survey

if TYPE_CHECKING:
    from rasterizer.camera import Camera

FindCameras: TypeAlias = "Callable[[Any, Path | None], Sequence[Camera]]"
"""From the scene, a Gaussians, and its file, if it is as the file has it, to the cameras of the
capture; none where there are none."""
COLUMN = "defect"
"""The extra column of a marked scene."""


@dataclass(frozen=True)
class Clean(Whole):
    """Remove the Gaussians for which `survey` has a reason; a line is said for each reason."""

    removes: ClassVar[bool] = True
    limits: Limits = USUAL
    capture: FindCameras | None = None
    """Gives the cameras of the capture: what none of them sees is removed. None: not asked."""
    where: Selection | None = None
    """Only what this selects is removed; None: whatever has a reason."""
    mark: bool = False
    """Remove nothing: write the number of the reason into the column `defect`."""
    reasons: Path | None = None
    """Where to write the number of the reason of every row, 0 for what stays, as .npy."""
    overwrite: bool = False
    """Whether that file may exist."""
    path: Path | None = None
    """Of the scene, where none but operations that remove rows came before."""

    def at(self, path: Path) -> Clean:
        return replace(self, path=path)

    def header(self, header: SceneHeader) -> SceneHeader:
        if not self.mark:
            return header
        return header.replace(extra={**header.extra, COLUMN: np.dtype(np.uint8)})

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        why = survey(table, self.limits)
        if self.capture is not None:
            mark_unseen(table, why, self.capture, self.path)
        if self.where is not None:
            why[~self.where.mask(table)] = KEPT
        counts = np.bincount(why, minlength=len(REASONS)).tolist()
        for number, (name, count) in enumerate(zip(REASONS, counts)):
            if count and number != KEPT:
                say(f"{count:,} {name}" + (f" ({COLUMN} {number})" if self.numbered else ""))
        if self.reasons is not None:
            write_reasons(self.reasons, why, overwrite=self.overwrite)
        if self.mark:
            return table.replace(extra={**table.extra, COLUMN: why})
        return table if counts[KEPT] == len(table) else table[why == KEPT]

    @property
    def numbered(self) -> bool:
        """Whether numbers of reasons are written somewhere."""
        return self.mark or self.reasons is not None


def clean(
    scene: Scene,
    limits: Limits = USUAL,
    *,
    cameras: Sequence[Camera] = (),
    where: Selection | str | None = None,
    say: Say = silent,
) -> Scene:
    """The scene without what is no part of it, of what `where` (a selection, or an expression)
    selects: see `survey`.

    With the `cameras` of the capture, also without what none of them sees. `say` receives a line
    for each reason, with its count.
    """
    some = None if where is None else as_selection(where)
    return apply(scene, Clean(limits, partial(_given, cameras), some), say=say)


def _given(cameras: Sequence[Camera], scene: Any, path: Path | None) -> Sequence[Camera]:
    return cameras


def mark_unseen(
    table: SplatTable, why: UInt8[np.ndarray, " n"], capture: FindCameras, path: Path | None
) -> None:
    """Give the rows without a reason that no camera sees their reason. Needs torch."""
    from gsedit.files.table import gaussians_of
    from gsedit.points.visibility import most_seen

    left = np.flatnonzero(why == KEPT)
    scene = gaussians_of(table[left])
    views = capture(scene, path)
    if len(views):
        unseen = most_seen(scene, views) < UNSEEN.threshold
        why[left[unseen]] = REASONS.index(UNSEEN.name)


def write_reasons(path: Path, reasons: np.ndarray, *, overwrite: bool = False) -> None:
    """Write an array of reasons as .npy, whole or not at all. Raises UsageError if it exists."""
    from gsedit.files.atomic import atomic_path

    with atomic_path(path, overwrite=overwrite) as temporary, temporary.open("wb") as handle:
        np.save(handle, reasons)
