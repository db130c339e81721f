"""2D Gaussians to a picture: order them by depth, list them by tile, blend the tiles."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import tiles
from rasterizer.blending import cpp_backend as compiled
from rasterizer.blending import torch_backend as wavefront
from rasterizer.blending.composite import composite
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.project import Box, Projected, cut_offs


class Splatted(NamedTuple):
    """What a rectangle of pixels receives, over black."""

    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    crossing: Int[Tensor, "h w"] | None
    """Row at which the transmittance falls to one half; -1: none. None: not asked for."""
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
    if execution.compile and compiled.load() is None:
        execution = replace(execution, compile=False)
    _, _, width, height = box
    xy, bins = list_tiles(projected, log_opacities, box, numerics, execution)
    table = torch.cat((xy, projected.whitening, log_opacities[:, None], features), -1)
    blended, through, crossing = composite(
        table, bins, width, height, numerics, execution, median=median
    )
    return Splatted(blended, through, crossing, bins.size)


def list_tiles(
    projected: Projected, log_opacities: Float[Tensor, " n"], box: Box, numerics: Numerics,
    execution: Execution,
) -> tuple[Float[Tensor, "n 2"], tiles.Bins]:  # fmt: skip
    """Positions relative to the box's corner, and who is in which tile."""
    left, top, width, height = box
    xy = projected.xy - projected.xy.new_tensor((left, top))
    with torch.no_grad():
        radius = cut_offs(log_opacities, numerics)
        footprints = tiles.Footprints(xy.detach(), projected.covariance, radius)
        overhead = (compiled if execution.compile else wavefront).PAIR_OVERHEAD
        size = execution.tile_size or tiles.choose_tile_size(footprints, width, height, overhead)
        order = tiles.depth_order(projected.order)
        size = min(size, max(width, height))
        boxes = execution.cull == "box"
        return xy, tiles.bin_tiles(footprints, order, size, width, height, boxes=boxes)
