"""2D Gaussians to a picture: order them by depth, list them by tile, blend the tiles."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import tiles
from rasterizer.blending.backend import Backend, Blended, BlendInputs, refuse_second_derivatives
from rasterizer.blending.choose import choose_backend
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.preprocess import Splats
from rasterizer.project import Box, cutoff_radii


def splat(
    splats: Splats,
    features: Float[Tensor, "m d"],
    box: Box,
    numerics: Numerics,
    *,
    execution: Execution = AUTO,
    median: bool = False,
) -> tuple[Blended, int]:
    """Blend 2D Gaussians with any number of features over the pixels of a box; and the side of the
    tiles, pixels.

    `execution` and the features' device and dtype choose the backend. Differentiable in xy,
    whitening, log-opacities and features.
    """
    _, _, width, height = box
    backend = choose_backend(execution, features.device, features.dtype)
    xy, bins = list_tiles(splats, box, numerics, execution, backend)
    columns = (xy, splats.projected.whitening, splats.log_opacities[:, None], features)
    table = torch.cat(columns, -1)
    inputs = BlendInputs(table, bins, width, height, numerics)
    return composite(inputs, backend, median=median), bins.size


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
        return xy, tiles.bin_tiles(footprints, order, size, width, height)


def composite(
    inputs: BlendInputs,
    backend: Backend,
    tracked: Float[Tensor, "r g"] | None = None,
    *,
    median: bool = False,
) -> Blended:
    """Blend Gaussians over their tiles; differentiable in `tracked`: the table, if None.

    `tracked` has the shape of the gradients that `backend.backward` gives. `median` asks for the
    median index. Raises RuntimeError in a backward pass with create_graph=True.
    """
    tracked = inputs.table if tracked is None else tracked
    return Blended(*_Composite.apply(tracked, inputs, backend, median))


class _Composite(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any, tracked: Float[Tensor, "r g"], inputs: BlendInputs, backend: Backend, median: bool
    ) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w"], Int[Tensor, "h w"] | None]:
        inputs = inputs._replace(table=inputs.table.detach())
        blended, ctx.saved = backend.forward(inputs, median, ctx.needs_input_grad[0])
        ctx.backend = backend
        # an output: an attribute of ctx that holds it would make a cycle, which is never freed
        ctx.save_for_backward(blended.transmittance)
        if blended.median_index is not None:
            ctx.mark_non_differentiable(blended.median_index)
        return blended.features, blended.transmittance, blended.median_index

    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def backward(  # type: ignore[override]
        ctx: Any,
        grad_features: Float[Tensor, "h w d"],
        grad_transmittance: Float[Tensor, "h w"],
        _: Any,
    ) -> tuple[Float[Tensor, "r g"] | None, ...]:
        refuse_second_derivatives()
        (transmittance,) = ctx.saved_tensors
        gradient = ctx.backend.backward(
            ctx.saved, transmittance, grad_features.contiguous(), grad_transmittance.contiguous()
        )
        return gradient, None, None, None
