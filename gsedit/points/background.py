"""A scene without its background: the subject alone, or what the cameras stand around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Bool, Float64

from gsedit.errors import UsageError
from gsedit.files.streams import Blocks, SceneHeader
from gsedit.files.table import SplatTable
from gsedit.points.filter import as_selection
from gsedit.points.operation import Kept, Say, Scene, apply, counted
from gsedit.points.selection.base import Selection
from gsedit.points.selection.part import OnSelection

if TYPE_CHECKING:
    from rasterizer.camera import Camera


@dataclass(frozen=True)
class RemoveBackground(OnSelection):
    """Keep the selected rows, which are the subject. Raises UsageError where that is all or
    nothing."""

    removes: ClassVar[bool] = True

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        return table[np.flatnonzero(inside)]

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Blocks:
        kept = Kept()
        subject = super().blocks(counted(blocks, kept, "before"), header, say)
        yield from counted(subject, kept, "after")
        if kept.after in (0, kept.before):
            found = "no background" if kept.after else "no subject"
            raise UsageError(
                f"{found} was found: choose another --within (a share of the cameras' distance "
                "from what they look at), or use gsedit filter --region with a mask"
            )


@dataclass(frozen=True)
class InTheMiddle(Selection):
    """What is near the point that the cameras look at.

    Nearer than `within` times the cameras' median distance from it: 1 is about what an orbit of
    cameras encloses.
    """

    cameras: Path
    """A cameras.json, or a folder of posed photos."""
    within: float = 0.5
    scene: Path | None = None
    """The scene's file, whose dataparser_transforms.json tells the frame of an export."""

    def __post_init__(self) -> None:
        if not 0 < self.within < np.inf:
            raise UsageError(f"within {self.within:g}: give a number above 0")

    @property
    def whole(self) -> bool:
        return True

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        from gsedit.points.selection.seen import load_views

        views = load_views(self.cameras, self.scene)
        middle, distance = looked_at([view.camera for view in views])
        away = np.linalg.norm(table.means.astype(np.float64) - middle, axis=1)
        return away <= self.within * distance


def looked_at(cameras: list[Camera]) -> tuple[Float64[np.ndarray, "3"], float]:
    """(the point nearest to all lines of sight, the cameras' median distance from it).

    Least squares over the middle lines of the views. Raises UsageError where they are parallel.
    """
    centres = np.stack([camera.centre.double().numpy() for camera in cameras])
    ahead = np.stack([camera.forward.double().numpy() for camera in cameras])
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    system = across.sum(0)
    if np.linalg.cond(system) > 1e4:
        raise UsageError(
            "the cameras look in parallel, at no common point: use gsedit crop --sphere X,Y,Z,R"
        )
    middle = np.linalg.solve(system, (across @ centres[:, :, None]).sum(0)[:, 0])
    return middle, float(np.median(np.linalg.norm(centres - middle, axis=1)))


def remove_background(scene: Scene, subject: Selection | str) -> Scene:
    """The scene without what `subject` does not select; a text is an expression. Raises UsageError
    where that is all or nothing."""
    return apply(scene, RemoveBackground(selection=as_selection(subject)))
