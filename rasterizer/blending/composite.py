"""Front-to-back blending of tiles, with its gradient: the only autograd.Function.

`m` Gaussians with `d` features, each listed by the tiles it touches. Per pixel, front to back,

    alpha_i = min(opacity_i exp(-|W_i (p - xy_i)|^2 / 2), alpha_max), 0 below alpha_min
    color   = sum_i T_i alpha_i c_i,   T_{i+1} = T_i (1 - alpha_i).

A tile is left once less than transmittance_min passes each of its pixels: what is left out is at
most that much of a colour. Going back, with c_i . g and g_T the loss's gradients of colour and T,

    dL/dalpha_i = T_i (c_i . g) - (sum_j>i T_j alpha_j (c_j . g) + T_end g_T) / (1 - alpha_i).

Two ways to the same numbers: in torch (`wavefront.py`), or compiled (`kernel.cpp`).
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from rasterizer.blending import cpp_backend as compiled
from rasterizer.blending import torch_backend as wavefront
from rasterizer.numerics import Execution, Numerics
from rasterizer.tiles import Bins


class Composite(NamedTuple):
    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    crossing: Int[Tensor, "h w"] | None
    """Gaussian at which the transmittance falls to one half; -1: none. None: not asked for."""


def composite(
    table: Float[Tensor, "m g"], bins: Bins, width: int, height: int,
    numerics: Numerics, execution: Execution, *, median: bool = False,
) -> Composite:  # fmt: skip
    """Blend Gaussians (rows: x, y, w0, w1, w2, log opacity, features...) over their tiles.

    `execution.compile` needs the kernel: ask `compiled.load` first.
    """
    return Composite(*_Blend.apply(table, bins, width, height, numerics, execution, median))


class _Blend(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any, table: Tensor, bins: Bins, width: int, height: int,
        numerics: Numerics, execution: Execution, median: bool,
    ) -> tuple[Tensor, Tensor, Tensor | None]:  # fmt: skip
        table = table.detach()
        settings = table, bins, width, height, numerics
        differentiate = ctx.needs_input_grad[0]
        if execution.compile:
            picture, light, crossing, kept = compiled.forward(
                *settings, median, differentiate=differentiate
            )
            backward = partial(compiled.backward, *settings, kept)
            ctx.save_for_backward(light)  # an output: held otherwise, it would never be freed
        else:
            picture, light, crossing, kept = wavefront.forward(
                *settings, median, block=execution.block, differentiate=differentiate
            )
            backward = partial(wavefront.backward, kept)
        ctx.bins, ctx.pairs_backward = bins, backward
        if crossing is not None:
            ctx.mark_non_differentiable(crossing)
        return picture, light, crossing

    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def backward(  # type: ignore[override]
        ctx: Any, grad_features: Tensor, grad_light: Tensor, _: Any
    ) -> tuple[Tensor | None, ...]:
        if torch.is_grad_enabled():  # the gradients of these gradients would be silently wrong
            raise RuntimeError("a picture has first derivatives only: leave out create_graph=True")
        upstream = grad_features.contiguous(), grad_light.contiguous()
        rows = ctx.pairs_backward(*ctx.saved_tensors, *upstream)
        # each Gaussian's pairs, tile by tile: the same sum on every run
        by_rank = embedding_bag(torch.arange(len(rows)), rows, ctx.bins.firsts, mode="sum")
        return by_rank.index_select(0, ctx.bins.rank), *(None,) * 6
