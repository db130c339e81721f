"""Selection of the part of a scene that the cameras stand around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float64

from gsedit.errors import UsageError
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.base import Selection
from gsedit.toolkit.selection.seen import load_views

if TYPE_CHECKING:
    from rasterizer.camera import Camera


@dataclass(frozen=True)
class InTheMiddle(Selection):
    """Gaussians near the point that the cameras look at.

    They are nearer to it than `within` times the median distance of the cameras from it; 1 is
    about the part that an orbit of cameras encloses.
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
        views = load_views(self.cameras, self.scene)
        middle, distance = looked_at([view.camera for view in views])
        away = np.linalg.norm(table.means.astype(np.float64) - middle, axis=1)
        return away <= self.within * distance


def looked_at(cameras: list[Camera]) -> tuple[Float64[np.ndarray, "3"], float]:
    """(the point nearest to all lines of sight, the cameras' median distance from it).

    Least squares over the middle lines of the views. Raises UsageError where they are parallel.
    """
    centers = np.stack([camera.center.double().numpy() for camera in cameras])
    ahead = np.stack([camera.forward.double().numpy() for camera in cameras])
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    system = across.sum(0)
    if np.linalg.cond(system) > 1e4:
        raise UsageError(
            "the cameras look in parallel, at no common point: use sphere(x, y, z, radius)"
        )
    middle = np.linalg.solve(system, (across @ centers[:, :, None]).sum(0)[:, 0])
    return middle, float(np.median(np.linalg.norm(centers - middle, axis=1)))
