"""Pixels outside the region of an edit, or outside given masks, which should stay as they were."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.evaluation_input import Mean
from gsedit.measures.interval import interval
from gsedit.measures.metrics import INSIDE, NEAREST, SquaredError, pooled_rmse
from gsedit.select.region import Region, coverage
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


def outside_means(
    errors: Sequence[SquaredError], of: Literal["region", "masks"], against: str
) -> dict[str, Mean]:
    """The RMSE and the PSNR over all pixels outside, from an error each view; none without any
    pixel."""
    error = pooled_rmse(errors)
    if error is None:
        return {}
    views = range(len(errors))
    within = interval(errors, [(i,) for i in views], lambda sums: (sums[0] / sums[1]) ** 0.5)
    low, high = within or (error, error)
    nearness = [min(psnr_from_rmse(each), NEAREST) for each in (error, high, low)]
    return {
        f"rmse_outside_{of}": Mean(error, len(errors), within, against),
        f"psnr_outside_{of}": Mean(
            nearness[0], len(errors), within and (nearness[1], nearness[2]), against
        ),
    }
