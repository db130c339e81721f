"""2D Gaussians to a picture: order them by depth, list them by tile, blend the tiles."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import tiles
from rasterizer.blending.backend import Backend, BlendInputs
from rasterizer.blending.choose import choose_backend
from rasterizer.blending.composite import composite
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.preprocess import Splats
from rasterizer.project import Box, cutoff_radii


class Splatted(NamedTuple):
    """What a rectangle of pixels receives, over black."""

    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    median_index: Int[Tensor, "h w"] | None
    """Which splat takes the transmittance to one half; -1: none. None: not asked for."""
    tile_size: int
    """Side of the tiles, pixels."""


def splat(
    splats: Splats,
    features: Float[Tensor, "m d"],
    box: Box,
    numerics: Numerics,
    *,
    execution: Execution = AUTO,
    median: bool = False,
) -> Splatted:
    """Blend 2D Gaussians with any number of features over the pixels of a box.

    `execution` and the features' device and dtype choose the backend. Differentiable in xy,
    whitening, log-opacities and features.
    """
    _, _, width, height = box
    backend = choose_backend(execution, features.device, features.dtype)
    xy, bins = list_tiles(splats, box, numerics, execution, backend)
    columns = (xy, splats.projected.whitening, splats.log_opacities[:, None], features)
    table = torch.cat(columns, -1)
    inputs = BlendInputs(table, bins, width, height, numerics, execution.block)
    return Splatted(*composite(inputs, backend, median=median), bins.size)


def list_tiles(
    splats: Splats, box: Box, numerics: Numerics, execution: Execution, backend: Backend
) -> tuple[Float[Tensor, "m 2"], tiles.Bins]:
    """Positions relative to the box's corner, pixels; and each tile's splats, front to back."""
    left, top, width, height = box
    projected = splats.projected
    xy = projected.xy - projected.xy.new_tensor((left, top))
    with torch.no_grad():
        radius = cutoff_radii(splats.log_opacities, numerics)
        footprints = tiles.Footprints(xy.detach(), projected.covariance, radius)
        size = execution.tile_size or tiles.choose_tile_size(
            footprints, width, height, backend.pair_overhead
        )
        size = min(size, max(width, height))
        order = tiles.depth_order(projected.sort_depth)
        boxes = execution.cull == "box"
        return xy, tiles.bin_tiles(footprints, order, size, width, height, boxes=boxes)
