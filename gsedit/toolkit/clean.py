"""Remove Gaussians that are not part of the captured scene, each for a reason that is reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import Float, UInt8

from gsedit.formats.flags import write_flags
from gsedit.formats.streams import SceneHeader
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.rules import Selection
from gsedit.toolkit.defects import KEPT, REASONS, UNSEEN, USUAL, Limits, find_defects
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.operation import Say, Scene, Whole, apply, silent

if TYPE_CHECKING:
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

FindCameras: TypeAlias = "Callable[[Any, Path | None], Sequence[Camera]]"
"""From the scene, a Gaussians, and its file, if it is as the file has it, to the cameras of the
capture; none where there are none."""
COLUMN = "defect"
"""The extra column of a marked scene."""


@dataclass(frozen=True)
class Clean(Whole):
    """Remove the Gaussians for which `find_defects` has a reason; each reason gets a line."""

    removes: ClassVar[bool] = True
    limits: Limits = USUAL
    capture: FindCameras | None = None
    """Gives the cameras of the capture: what none of them sees is removed. None: not asked."""
    where: Selection | None = None
    """Only what this selects is removed; None: whatever has a reason."""
    mark: bool = False
    """Remove nothing: write the number of the reason into the column `defect`."""
    reasons: Path | None = None
    """File (.npy) for the number of each row's reason; 0 means that the row stays."""
    overwrite: bool = False
    """Whether that file may exist."""
    path: Path | None = None
    """File that the rows come from, if only operations that remove rows came before."""

    def at(self, path: Path) -> Clean:
        return replace(self, path=path)

    def header(self, header: SceneHeader) -> SceneHeader:
        if not self.mark:
            return header
        return header.replace(extra={**header.extra, COLUMN: np.dtype(np.uint8)})

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        why = find_defects(table, self.limits)
        if self.capture is not None:
            mark_unseen(table, why, self.capture, self.path)
        if self.where is not None:
            why[~self.where.mask(table)] = KEPT
        counts = np.bincount(why, minlength=len(REASONS)).tolist()
        for number, (name, count) in enumerate(zip(REASONS, counts)):
            if count and number != KEPT:
                say(f"{count:,} {name}" + (f" ({COLUMN} {number})" if self.numbered else ""))
        if self.reasons is not None:
            write_flags(why, self.reasons, overwrite=self.overwrite)
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
    selects: see `find_defects`.

    With the `cameras` of the capture, also without what none of them sees. `say` receives a line
    for each reason, with its count.
    """
    some = None if where is None else as_selection(where)
    return apply(scene, Clean(limits, lambda scene, path: cameras, some), say=say)


def mark_unseen(
    table: SplatTable, why: UInt8[np.ndarray, " n"], capture: FindCameras, path: Path | None
) -> None:
    """Give the rows without a reason that no camera sees their reason. Needs torch."""
    left = np.flatnonzero(why == KEPT)
    scene = gaussians_of(table[left])
    views = capture(scene, path)
    if len(views):
        unseen = most_seen(scene, views) < UNSEEN.threshold
        why[left[unseen]] = REASONS.index(UNSEEN.name)


SIZE_PIXELS = 128
"""Longer side of the renders, pixels. A Gaussian covers a few pixels even where it is small, as
renderers widen every one; larger pictures say the same and take longer."""


def most_seen(scene: Gaussians, cameras: Sequence[Camera]) -> Float[np.ndarray, " n"]:
    """The largest contribution of each Gaussian to one of the views, in pixels: its blending
    weights, summed over the picture."""
    from rasterizer.render import contributions

    most = scene.means.new_zeros(len(scene))
    for camera in cameras:
        scale = min(1.0, SIZE_PIXELS / max(camera.width, camera.height))
        size = (max(1, round(side * scale)) for side in (camera.width, camera.height))
        most = most.maximum(contributions(scene, camera.resized(*size)).to(most))
    return most.numpy()
