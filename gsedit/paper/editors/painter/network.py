"""The network that paints: convolutions whose normalisations carry the style.

Conditional instance normalisation (Dumoulin, Shlens and Kudlur 2017): every style has its own scale
and offset of each normalised channel, and all share the convolutions. `v` pictures of `h w` pixels,
`c` channels of `y x` positions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import repeat
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

CELL = 4
"""Pixels of a position of the bottleneck: two convolutions of stride 2 come before it."""
EPSILON = 1e-5
"""Added to variances."""


class Affine(NamedTuple):
    """What a style makes of a normalised layer."""

    gamma: Float[Tensor, " c"]
    beta: Float[Tensor, " c"]


class Moments(NamedTuple):
    """Mean and variance of a layer's channels, by which it is normalised."""

    mean: Float[Tensor, "n c 1 1"]
    variance: Float[Tensor, "n c 1 1"]


Agree = Callable[[int, Float[Tensor, "v c y x"]], Float[Tensor, "v c y x"]]
"""(residual block, from 1; its output) -> the output with which the network goes on."""


class PaintNetwork(nn.Module):
    """Two halvings, residual blocks, two doublings: the convolutions, without a style."""

    def __init__(self, blocks: int) -> None:
        super().__init__()
        sizes = [(3, 32, 9), (32, 32, 3), (32, 32, 3)]
        self.contract = nn.ModuleList(
            _convolution(*size, stride=1 + (k > 0)) for k, size in enumerate(sizes)
        )
        self.residual = nn.ModuleList(
            nn.ModuleList(_convolution(32, 32, 3) for _ in range(2)) for _ in range(blocks)
        )
        sizes = [(32, 8, 3), (8, 4, 3), (4, 3, 9)]
        self.expand = nn.ModuleList(_convolution(*size) for size in sizes)

    def forward(
        self,
        images: Float[Tensor, "v 3 h w"],
        style: Sequence[Affine],
        moments: Sequence[Moments] | None = None,
        pooled: bool = True,
        agree: Agree | None = None,
    ) -> tuple[Float[Tensor, "v 3 h w"], list[Moments]]:
        """Painted pictures in [0, 1], and the moments by which layers were normalised."""
        used: list[Moments] = []
        affine = iter(style)
        known = iter(moments) if moments is not None else repeat(None)

        def layer(conv: nn.Conv2d, x: Tensor) -> Tensor:
            margin = conv.kernel_size[0] // 2
            y = conv(F.pad(x, (margin,) * 4, mode="reflect"))
            used.append(next(known) or _moments(y, pooled))
            (mean, variance), (gamma, beta) = used[-1], next(affine)
            return torch.addcmul(
                beta[:, None, None], y - mean, gamma[:, None, None] / (variance + EPSILON).sqrt()
            )

        x = images
        for conv in self.contract:
            x = layer(conv, x).relu()
        for k, (first, second) in enumerate(self.residual, start=1):
            x = x + layer(second, layer(first, x).relu())
            x = agree(k, x) if agree else x
        for conv in self.expand[:2]:
            x = layer(conv, F.interpolate(x, scale_factor=2.0, mode="nearest")).relu()
        return layer(self.expand[2], x).sigmoid(), used


def _convolution(inputs: int, outputs: int, side: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, side, stride, bias=False)


def _moments(x: Float[Tensor, "v c y x"], pooled: bool) -> Moments:
    variance, mean = torch.var_mean(x, (0, 2, 3) if pooled else (2, 3), correction=0, keepdim=True)
    return Moments(mean, variance)
