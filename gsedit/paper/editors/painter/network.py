"""The network that paints: convolutions whose normalisations carry the style.

Conditional instance normalisation (Dumoulin, Shlens and Kudlur 2017): every style has its own scale
and offset of each normalised channel, and all share the convolutions. `v` pictures of `h w` pixels,
`c` channels of `y x` positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.errors import InputError
from gsedit.views.image_ops import pad_to_multiple

CELL = 4
"""Pixels of a position of the bottleneck: two convolutions of stride 2 come before it."""
EPSILON = 1e-5
"""Added to the variances that channels are divided by."""


class Affine(NamedTuple):
    """A style of one layer: scale and offset of its normalised channels."""

    gamma: Float[Tensor, " c"]
    beta: Float[Tensor, " c"]


class Moments(NamedTuple):
    """Mean and variance of a layer's channels, by which it is normalised."""

    mean: Float[Tensor, "n c 1 1"]
    variance: Float[Tensor, "n c 1 1"]


def mixed(styles: Sequence[Sequence[Affine]], shares: Sequence[float]) -> tuple[Affine, ...]:
    """A style between styles of one network, each with its share of the whole.

    Shares are at least 0, not all 0, and need not add up to 1. Raises ValueError for others.
    """
    if len(styles) != len(shares) or min(shares, default=0) < 0 or not sum(shares) > 0:
        raise ValueError(f"{len(styles)} styles cannot be mixed by the shares {tuple(shares)}")
    parts = torch.tensor(shares) / sum(shares)
    return tuple(
        Affine(*(torch.tensordot(parts, torch.stack(each), 1) for each in zip(*layer)))
        for layer in zip(*styles)
    )


Agree = Callable[[int, Float[Tensor, "v c y x"]], Float[Tensor, "v c y x"]]
"""(residual block, from 1; its output) -> the output with which the network goes on."""


class PaintNetwork(nn.Module):
    """Two halvings, residual blocks, two doublings: the convolutions, without a style.

    `contract` and `expand` are the channels of the layers before the blocks and after them. Of a
    network that is `folded`, the layers before the blocks have an offset in place of a style.
    """

    def __init__(
        self,
        blocks: int = 6,
        contract: tuple[int, int, int] = (32, 32, 32),
        expand: tuple[int, int] = (8, 4),
        folded: bool = False,
    ) -> None:
        super().__init__()
        wide = contract[-1]
        self.contract = nn.ModuleList(
            nn.Conv2d(*sizes, 1 + (k > 0), bias=folded)
            for k, sizes in enumerate(zip((3, *contract), contract, (9, 3, 3)))
        )
        self.residual = nn.ModuleList(
            nn.ModuleList(nn.Conv2d(wide, wide, 3, bias=False) for _ in range(2))
            for _ in range(blocks)
        )
        self.expand = nn.ModuleList(
            nn.Conv2d(*sizes, bias=False) for sizes in zip((wide, *expand), (*expand, 3), (3, 3, 9))
        )

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

        def layer(conv: Any, x: Tensor) -> Tensor:
            margin = conv.kernel_size[0] // 2
            y = conv(F.pad(x, (margin,) * 4, mode="reflect"))
            if conv.bias is not None:
                return y
            given = next(known)
            mean = given.mean if given else _mean(y, pooled)
            y = y.sub_(mean)
            variance = given.variance if given else _mean_square(y, pooled)
            used.append(Moments(mean, variance))
            gamma, beta = (each[:, None, None] for each in next(affine))
            return torch.addcmul(beta, y, gamma / (variance + EPSILON).sqrt())

        x = images
        for conv in self.contract:
            x = layer(conv, x).relu_()
        for k, pair in enumerate(self.residual, start=1):
            first, second = pair.children()
            x = x + layer(second, layer(first, x).relu_())
            x = agree(k, x) if agree else x
        for conv in self.expand[:2]:
            x = layer(conv, F.interpolate(x, scale_factor=2.0, mode="nearest")).relu_()
        return layer(self.expand[2], x).sigmoid(), used


@torch.no_grad()
def painted(
    network: PaintNetwork, pictures: Float[Tensor, "v h w 3"], style: Sequence[Affine]
) -> Float[Tensor, "v h w 3"]:
    """Pictures of any size as a network paints them, sRGB in [0, 1]."""
    height, width = pictures.shape[1:3]
    images, _ = network(padded(pictures), style)
    return images.movedim(1, -1)[:, :height, :width]


def padded(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v 3 H W"]:
    """Pictures as a network takes them: channels first, continued to sides of whole cells."""
    return pad_to_multiple(pictures, CELL, "mirror").movedim(-1, 1)


def _mean(x: Float[Tensor, "v c y x"], pooled: bool) -> Float[Tensor, "n c 1 1"]:
    means = x.flatten(2).mean(2)
    return (means.mean(0, keepdim=True) if pooled else means)[..., None, None]


def _mean_square(x: Float[Tensor, "v c y x"], pooled: bool) -> Float[Tensor, "n c 1 1"]:
    """As torch.var_mean would say of centred numbers, but twenty times as quick."""
    squares = torch.linalg.vector_norm(x.flatten(2), dim=2).square() / x[0, 0].numel()
    return (squares.mean(0, keepdim=True) if pooled else squares)[..., None, None]


@contextmanager
def weights_of(path: Path) -> Iterator[dict[str, Tensor]]:
    """Weights by name, float32: those of 8 bits in the file times the scales of their channels.

    InputError is raised where the file is missing or damaged, and for whatever is raised meanwhile.
    """
    from safetensors.torch import load_file

    try:
        held = load_file(path)
        for name in [each for each in held if each.endswith(".scale")]:
            weight = f"{name.removesuffix('.scale')}.weight"
            channels = held[weight].movedim(0, -1)
            held[weight] = (channels * held.pop(name)).movedim(-1, 0).contiguous()
        yield held
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the painter's weights ({reason}): install gsedit again"
        ) from error


def hold(network: nn.Module, weights: dict[str, Tensor]) -> None:
    """Give a network, made on the device "meta", its weights, of which none will learn."""
    network.load_state_dict(weights, assign=True)
    network.eval().requires_grad_(False)
