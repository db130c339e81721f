"""Selection of the part of a scene that the cameras stand around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from gsedit.errors import UsageError
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.seen import ThroughCameras


@dataclass(frozen=True)
class InTheMiddle(ThroughCameras):
    """Gaussians near the point that the cameras look at.

    They are nearer to it than `within` times the median distance of the cameras from it; 1 is
    about the part that an orbit of cameras encloses.
    """

    within: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.within < np.inf:
            raise UsageError(f"within {self.within:g}: give a number above 0")

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        import torch

        from gsedit.cameras.paths import common_point

        cameras = [view.camera for view in self.views]
        middle = common_point(cameras)
        if middle is None:
            raise UsageError("the cameras look at no common point: use sphere(x, y, z, radius)")
        centers = torch.stack([camera.center.detach().double() for camera in cameras])
        distance = np.median((centers - middle).norm(dim=1).numpy())
        away = np.linalg.norm(table.means.astype(np.float64) - middle.numpy(), axis=1)
        return away <= self.within * distance
