"""Selections by views: what cameras see, and what masks on photos or renders show.

Both render the scene with torch, which is loaded when a mask is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit.selection.base import Selection

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
class Seen(Selection):
    """Select Gaussians that contribute at least `pixels` to all pictures of a capture together.

    The contribution to a pixel is the blending weight: what is hidden has none. Pictures are
    `SIZE_PIXELS` pixels wide, of at most `CAMERAS` cameras.
    """

    cameras: Path
    """A cameras.json, or a folder of posed photos (see `--data`)."""
    pixels: float = LEAST_PIXELS
    scene: Path | None = None
    """The scene's file, whose dataparser_transforms.json tells the frame of an export."""

    def __post_init__(self) -> None:
        if not self.pixels > 0:
            raise UsageError(f"seen: {self.pixels:g} pixels: give more than 0")

    @property
    def whole(self) -> bool:
        return True

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        import torch

        from rasterizer.render import contributions

        if not len(table):
            return np.zeros(0, bool)
        views = load_views(self.cameras, self.scene)
        with torch.no_grad():
            scene = gaussians_of(table)
            total = torch.zeros(len(scene))
            for view in views[:: -(-len(views) // CAMERAS)]:
                total += contributions(scene, view.camera)
        return (total >= self.pixels).numpy()


@dataclass(frozen=True)
class Drawn(Selection):
    """Select by masks that were drawn on photos or renders: see `gsedit.regions.masks`."""

    masks: Path
    """A .png file named after its view, or a folder of them."""
    cameras: Path
    """A cameras.json, or a folder of posed photos, with the views of those names."""
    scene: Path | None = None
    """Scene file that the cameras belong to; None: the frame of the file that is selected from."""

    @property
    def whole(self) -> bool:
        return True

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        from gsedit.regions.lift import lift
        from gsedit.regions.masks import read_masks
        from gsedit.regions.subject import find_drawn

        views = load_views(self.cameras, self.scene)
        masks = read_masks(self.masks, views)
        scene = gaussians_of(table)
        lifted = lift(scene, [views[i].camera for i in masks], list(masks.values()))
        return find_drawn(scene, lifted).numpy()


def load_views(cameras: Path, scene: Path | None) -> Sequence[View | Viewpoint]:
    """The cameras of a cameras.json, or of posed photos, on pictures `SIZE_PIXELS` pixels wide.

    Raises InputError for what is neither.
    """
    from gsedit.datasets.cameras_json import NAME, read_cameras
    from gsedit.datasets.export_frame import in_export_frame
    from gsedit.datasets.load import load_dataset
    from gsedit.datasets.viewpoints import same_size

    path = cameras.expanduser()
    if (path / NAME).is_file():
        path = path / NAME
    if path.is_file() and path.name != "transforms.json":
        return same_size(read_cameras(path), SIZE_PIXELS)
    photos = load_dataset(path, size=SIZE_PIXELS)
    return (photos if scene is None else in_export_frame(photos, path, scene)).views
