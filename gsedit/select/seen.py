"""Selections by the cameras of a capture: what they see, and what they stand around.

The scene is rendered with torch, which is loaded when a mask is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.rules import WholeSelection

if TYPE_CHECKING:
    from gsedit.datasets.dataset import View
    from gsedit.datasets.viewpoints import Viewpoint

SIZE_PIXELS = 256
"""Longer side of the pictures, pixels."""
LEAST_PIXELS = 0.01
"""Pixels of that size, in all pictures together: less than the eye sees of a Gaussian."""
CAMERAS = 64
"""Largest number of cameras; of more, every k-th is taken: each costs a render and its backward
pass."""


@dataclass(frozen=True)
class ThroughCameras(WholeSelection):
    """A selection that looks at the scene through the cameras of its capture."""

    cameras: Path
    """A cameras.json, or a folder of posed photos (see `--data`)."""
    scene: Path | None = field(default=None, kw_only=True)
    """Scene file that the cameras belong to: the dataparser_transforms.json beside it tells the
    frame of an export. None: the frame of the file that is selected from."""

    @property
    def views(self) -> Sequence[View | Viewpoint]:
        """The cameras, on pictures `SIZE_PIXELS` wide. Raises InputError for what is none."""
        from gsedit.datasets.cameras_json import NAME, read_cameras
        from gsedit.datasets.export_frame import in_export_frame
        from gsedit.datasets.load import load_dataset
        from gsedit.datasets.viewpoints import same_size

        path = self.cameras.expanduser()
        if (path / NAME).is_file():
            path = path / NAME
        if path.is_file() and path.name != "transforms.json":
            return same_size(read_cameras(path), SIZE_PIXELS)
        photos = load_dataset(path, size=SIZE_PIXELS)
        return (photos if self.scene is None else in_export_frame(photos, path, self.scene)).views


@dataclass(frozen=True)
class Seen(ThroughCameras):
    """Select Gaussians that contribute at least `pixels` to all pictures of a capture together.

    The contribution to a pixel is the blending weight: what is hidden has none. Pictures are
    `SIZE_PIXELS` pixels wide, of at most `CAMERAS` cameras.
    """

    pixels: float = LEAST_PIXELS

    def __post_init__(self) -> None:
        if not self.pixels > 0:
            raise UsageError(f"seen: {self.pixels:g} pixels: give more than 0")

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        import torch

        from rasterizer.render import contributions

        if not len(table):
            return np.zeros(0, bool)
        views = self.views
        with torch.no_grad():
            scene = gaussians_of(table)
            total = torch.zeros(len(scene))
            for view in views[:: -(-len(views) // CAMERAS)]:
                total += contributions(scene, view.camera)
        return (total >= self.pixels).numpy()


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
