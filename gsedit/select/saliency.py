"""Saliency of pictures, by a published network: U2-Net-p (Qin et al. 2020) with its weights.

`v` views of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import interpolate, max_pool2d

from gsedit.errors import InputError

WIDTH, INNER = 64, 16
"""Channels between the blocks, and within them."""
DILATIONS = (1, 2, 4, 8)
"""Distances between the taps of the convolutions of a block that keeps its size."""


def _conv(inputs: int, outputs: int, dilation: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation)


def _resized(x: Float[Tensor, "v c h w"], like: Tensor) -> Float[Tensor, "v c i j"]:
    return interpolate(x, like.shape[-2:], mode="bilinear", align_corners=False)


class Block(nn.Module):
    """A residual U-block: features at `depth` scales, halved from one to the next, and back up;
    `flat` ones dilate their convolutions instead."""

    def __init__(self, inputs: int, depth: int, *, flat: bool = False) -> None:
        super().__init__()
        self.flat = flat
        dilations = DILATIONS if flat else (*(1,) * (depth - 1), 2)
        sizes = (WIDTH, *(INNER,) * (depth - 1))
        self.first = _conv(inputs, WIDTH)
        self.down = nn.ModuleList(_conv(n, INNER, d) for n, d in zip(sizes, dilations, strict=True))
        outputs = (WIDTH, *(INNER,) * (depth - 2))
        back = dilations[:-1] if flat else (1,) * (depth - 1)
        self.up = nn.ModuleList(_conv(2 * INNER, n, d) for n, d in zip(outputs, back, strict=True))

    def forward(self, x: Float[Tensor, "v c h w"]) -> Float[Tensor, "v k h w"]:
        x = first = self.first(x).relu()
        kept: list[Tensor] = []
        for i, conv in enumerate(self.down):
            halved = not self.flat and 0 < i < len(self.down) - 1
            x = conv(max_pool2d(x, 2, ceil_mode=True) if halved else x).relu()
            kept.append(x)
        kept.pop()
        for conv in reversed(self.up):
            below = kept.pop()
            x = conv(torch.cat((_resized(x, below), below), 1)).relu()
        return x + first


class U2Net(nn.Module):
    """Pictures to the probability that a pixel is of what stands out, 320x320 pixels at best."""

    def __init__(self) -> None:
        super().__init__()
        shapes: Sequence[tuple[int, bool]] = (
            (7, False), (6, False), (5, False), (4, False), (4, True), (4, True),
        )  # fmt: skip
        inputs = (3, *(WIDTH,) * 5)
        self.down = nn.ModuleList(
            Block(n, depth, flat=flat) for n, (depth, flat) in zip(inputs, shapes, strict=True)
        )
        self.up = nn.ModuleList(Block(2 * WIDTH, depth, flat=flat) for depth, flat in shapes[:5])
        self.sides = nn.ModuleList(_conv(WIDTH, 1) for _ in shapes)
        self.joined = nn.Conv2d(len(shapes), 1, 1)

    def forward(self, x: Float[Tensor, "v 3 h w"]) -> Float[Tensor, "v h w"]:
        """Return the probabilities for normalised pictures."""
        kept: list[Tensor] = []
        for i, block in enumerate(self.down):
            x = block(max_pool2d(x, 2, ceil_mode=True) if i else x)
            kept.append(x)
        features = [kept.pop()]
        for block in reversed(self.up):
            below = kept.pop()
            features.append(block(torch.cat((_resized(features[-1], below), below), 1)))
        sides = [conv(each) for conv, each in zip(self.sides, reversed(features), strict=True)]
        maps = [sides[0], *(_resized(each, sides[0]) for each in sides[1:])]
        return self.joined(torch.cat(maps, 1)).sigmoid()[:, 0]


WEIGHTS = Path(__file__).with_name("u2net.safetensors")
SIDE = 320
"""Sides of the square that the network looks at, pixels: it was trained on these."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and deviation of the colors of its training pictures: red, green, blue."""


@torch.no_grad()
def salient(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
    """The probability that each pixel is of what stands out in its picture, in [0, 1].

    Pictures are sRGB in [0, 1]. Raises InputError for weights that are missing or damaged.
    """
    network = load_network()
    size = pictures.shape[1:3]
    x = pictures.float().permute(0, 3, 1, 2)
    x = interpolate(x, (SIDE, SIDE), mode="bilinear", antialias=True).clamp(0, 1)
    x = x / x.amax((1, 2, 3), keepdim=True).clamp_min(1e-6)
    x = (x - x.new_tensor(MEAN)[:, None, None]) / x.new_tensor(DEVIATION)[:, None, None]
    x = x.contiguous(memory_format=torch.channels_last)  # a third quicker on AVX-512
    maps = torch.cat([network(each[None]) for each in x])[:, None]
    return interpolate(maps, size, mode="bilinear", antialias=True)[:, 0].clamp(0, 1)


def load_network(path: Path = WEIGHTS) -> U2Net:
    """The network with the weights of a file, kept until the file changes.

    Raises InputError for a file that is missing, damaged or of another network.
    """
    try:
        return _load(path, path.stat().st_mtime_ns)
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights that find the subject ({reason}): install gsedit "
            "again, or name the part with --at, --phrase or --region"
        ) from error


@lru_cache(maxsize=1)
def _load(path: Path, modified_ns: int) -> U2Net:
    from safetensors.torch import load_file

    with torch.random.fork_rng():  # initial weights would take numbers from the global generator
        network = U2Net()
    network.load_state_dict(load_file(path))
    as_last = nn.utils.convert_conv2d_weight_memory_format
    return as_last(network.eval().requires_grad_(False), torch.channels_last)
