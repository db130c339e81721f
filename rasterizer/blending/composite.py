"""Front-to-back blending of tiles, with its gradient, as an autograd.Function.

`m` Gaussians with `d` features, each listed by the tiles it touches. Per pixel, front to back,

    alpha_i = min(opacity_i exp(-|W_i (p - xy_i)|^2 / 2), alpha_max), 0 below alpha_min
    color   = sum_i T_i alpha_i c_i,   T_{i+1} = T_i (1 - alpha_i).

A tile is finished once at most transmittance_min passes each of its pixels: what is left out is at
most that much of a colour. Going back, with c_i . g and g_T the loss's gradients of colour and T,

    dL/dalpha_i = T_i (c_i . g) - (sum_j>i T_j alpha_j (c_j . g) + T_end g_T) / (1 - alpha_i).

A `Backend` computes both: see `backend.py`.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.backend import Backend, Blended, BlendInputs, refuse_second_derivatives


def composite(inputs: BlendInputs, backend: Backend, *, median: bool = False) -> Blended:
    """Blend Gaussians over their tiles; differentiable in `inputs.table`.

    `median` asks for the median index. Raises RuntimeError in a backward pass with
    create_graph=True.
    """
    return Blended(*_Composite.apply(inputs.table, inputs, backend, median))


class _Composite(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any,
        table: Float[Tensor, "m g"],
        inputs: BlendInputs,
        backend: Backend,
        median: bool,
    ) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w"], Int[Tensor, "h w"] | None]:
        inputs = inputs._replace(table=table.detach())
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
    ) -> tuple[Float[Tensor, "m g"] | None, ...]:
        refuse_second_derivatives()
        (transmittance,) = ctx.saved_tensors
        by_table = ctx.backend.backward(
            ctx.saved, transmittance, grad_features.contiguous(), grad_transmittance.contiguous()
        )
        return by_table, None, None, None
