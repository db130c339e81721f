"""2D Gaussians to a picture: order them by depth, list them by tile, blend the tiles."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import tiles
from rasterizer.composite import composite
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.project import Box, Projected


class Splatted(NamedTuple):
    """What a rectangle of pixels receives, over black."""

    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    crossing: Int[Tensor, "h w"]
    """Row at which the transmittance falls to one half; -1: none, or not asked for."""
    tile_size: int


def splat(
    projected: Projected,
    log_opacities: Float[Tensor, " n"],
    features: Float[Tensor, "n d"],
    box: Box,
    numerics: Numerics,
    *,
    execution: Execution = AUTO,
    median: bool = False,
) -> Splatted:
    """Blend 2D Gaussians with any number of features over the pixels of a box.

    Differentiable in xy, whitening, log-opacities and features.
    """
    left, top, width, height = box
    xy = projected.xy - projected.xy.new_tensor((left, top))
    with torch.no_grad():
        order = tiles.depth_order(projected.order)
        reach = 2 * (log_opacities - numerics.log_alpha_min)
        footprints = tiles.Footprints(
            xy[order], projected.covariance[order], reach.clamp_min(0).sqrt()[order]
        )
        size = execution.tile_size or tiles.choose_tile_size(footprints, width, height)
        bins = tiles.bin_tiles(footprints, size, width, height)
    table = torch.cat((xy, projected.whitening, log_opacities[:, None], features), -1)[order]
    blended, through, crossing = composite(table, bins, width, height, numerics, median)
    if median:  # from rank in depth to row; -1 stays
        crossing = torch.cat((order, order.new_tensor([-1])))[crossing]
    return Splatted(blended, through, crossing, size)
