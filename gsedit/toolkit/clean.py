"""Remove Gaussians that are not part of the captured scene, each for a reason that is reported, and
repair rows that no renderer can draw, by the smallest change that makes them valid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import Float, UInt8

from gsedit.formats.flags import write_flags
from gsedit.formats.quantised import LOGIT_MAX
from gsedit.formats.streams import Blocks, SceneHeader
from gsedit.formats.validity import invalid_rows, wrong_values
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.selection import Selection
from gsedit.toolkit.defects import (
    KEPT,
    REASONS,
    ROTATION,
    UNSEEN,
    USUAL,
    Limits,
    find_defects,
    invalid,
)
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.operation import Operation, Say, Scene, Whole, apply, silent

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
        most = most.maximum(contributions(scene, camera.fitted(SIZE_PIXELS)).to(most))
    return most.numpy()


FLAT = float(np.log(np.finfo(np.float32).tiny))
"""The log scale of what has no thickness: of the smallest normal float."""


@dataclass(frozen=True)
class Repair(Operation):
    """Mend invalid rows, and remove those that cannot be mended; valid rows stay as they are."""

    removes: ClassVar[bool] = True

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Iterator[SplatTable]:
        counts: Counter[str] = Counter()
        for block in blocks:
            yield repaired(block, counts)
        for what, count in counts.items():
            say(f"{count:,} {what}")
        if not counts:
            say("nothing to repair")


def repaired(table: SplatTable, counts: Counter[str]) -> SplatTable:
    """The rows that are valid or could be mended; what was done is counted, by a phrase."""
    if not invalid_rows(table).any():
        return table
    changes = {}
    found = invalid(table)
    infinite = np.isinf(table.logit_opacities)
    if infinite.any():
        changes["logit_opacities"] = np.where(
            infinite,
            np.copysign(np.float32(LOGIT_MAX), table.logit_opacities),
            table.logit_opacities,
        )
    flat = np.isneginf(table.log_scales)
    if flat.any():
        changes["log_scales"] = np.where(flat, np.float32(FLAT), table.log_scales)
    with np.errstate(invalid="ignore"):
        spread = np.ptp(changes.get("log_scales", table.log_scales), axis=1)
    unturned = found[ROTATION.name] & (spread <= np.log(ROTATION.threshold))
    if unturned.any():
        identity = np.array([1, 0, 0, 0], np.float32)
        changes["quats"] = np.where(unturned[:, None], identity, table.quats)
    blank = wrong_values(table)["sh"]
    blank[:, 0] = False
    if blank.any():
        changes["sh"] = np.where(blank, np.float32(0), table.sh)
    mended = table.replace(**changes)
    left = invalid_rows(mended)
    for what, rows in (
        ("infinite opacities became 15 or -15 (logits)", infinite),
        ("scales of zero became the smallest float", flat.any(1)),
        ("lost rotations of round Gaussians became the identity", unturned),
        ("Gaussians lost view-dependent colors that were NaN or infinite", blank.any((1, 2))),
    ):
        counts[what] += int((rows & ~left).sum())
    for name, rows in invalid(mended).items():
        counts[f"Gaussians removed: {name} cannot be mended"] += int((rows & left).sum())
        left &= ~rows  # one reason a row
    counts += Counter()  # without those of 0
    return mended[~invalid_rows(mended)]


def repair(scene: Scene, say: Say = silent) -> Scene:
    """The scene with all rows valid: see `Repair`. `say` receives what was done, with counts."""
    return apply(scene, Repair(), say=say)
