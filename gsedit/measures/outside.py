"""Pixels outside the region of an edit, which should stay as they were."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.measures.metrics import INSIDE
from gsedit.regions.region import Region, coverage
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


def pixels_outside(
    parts: Sequence[tuple[Region, Gaussians]], camera: Camera, execution: Execution = AUTO
) -> Bool[Tensor, "h w"]:
    """The pixels of which less than INSIDE comes from the region in any of the scenes.

    One (region, scene) for an edit of colors; with what was there before and what is there after
    where objects went: both places belong to the edit.
    """
    shares = [coverage(region, scene, camera, execution) for region, scene in parts]
    return torch.stack([share < INSIDE for share in shares]).all(0)
