"""Networks that paint: convolutions whose normalisations carry the style; and the one that finds
the style of any picture.

Conditional instance normalisation (Dumoulin, Shlens and Kudlur 2017): every style has its own scale
and offset of each normalised channel, and all share the convolutions. For any picture (Ghiasi, Lee,
Kudlur, Dumoulin and Shlens 2017) a MobileNetV2 makes a vector of it, and linear maps make of the
vector those scales and offsets. `v` pictures of `h w` pixels, `c` channels of `y x` positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.errors import InputError, UsageError
from gsedit.formats.pictures import fitted_size, read_photo, turned_size
from gsedit.views.image_ops import pad_to_multiple

CELL = 4
"""Pixels of a position of the bottleneck: two convolutions of stride 2 come before it."""
EPSILON = 1e-5
"""Added to the variances that channels are divided by."""


class Affine(NamedTuple):
    """A style of one layer: scale and offset of its normalised channels."""

    gamma: Float[Tensor, " c"]
    beta: Float[Tensor, " c"]


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
        self, images: Float[Tensor, "v 3 h w"], style: Sequence[Affine], agree: Agree | None = None
    ) -> Float[Tensor, "v 3 h w"]:
        """Painted pictures in [0, 1], each normalised by its own statistics."""
        affine = iter(style)

        def layer(conv: Any, x: Tensor) -> Tensor:
            margin = conv.kernel_size[0] // 2
            y = conv(F.pad(x, (margin,) * 4, mode="reflect"))
            if conv.bias is not None:
                return y
            y = y.sub_(y.flatten(2).mean(2)[..., None, None])
            # as torch.var_mean would say, but twenty times as quick
            variance = torch.linalg.vector_norm(y.flatten(2), dim=2).square() / y[0, 0].numel()
            gamma, beta = (each[:, None, None] for each in next(affine))
            scale = gamma / (variance + EPSILON).sqrt()[..., None, None]
            return torch.addcmul(beta, y, scale, out=y)

        x = images
        for conv in self.contract:
            x = layer(conv, x).relu_()
        for k, pair in enumerate(self.residual, start=1):
            first, second = pair.children()
            x = x + layer(second, layer(first, x).relu_())
            x = agree(k, x) if agree else x
        for conv in self.expand[:2]:
            x = layer(conv, F.interpolate(x, scale_factor=2.0, mode="nearest")).relu_()
        return layer(self.expand[2], x).sigmoid()


@torch.no_grad()
def painted(
    network: PaintNetwork,
    pictures: Float[Tensor, "v h w 3"],
    style: Sequence[Affine],
    agree: Agree | None = None,
) -> Float[Tensor, "v h w 3"]:
    """Pictures of any size as a network paints them, sRGB in [0, 1]; it computes in float32."""
    height, width = pictures.shape[1:3]
    whole = pad_to_multiple(pictures.float(), CELL, "mirror").movedim(-1, 1)
    # views that need not agree one by one: less memory, which is quicker to get
    parts = whole.split(1 if agree is None else len(whole))
    made = torch.cat([network(each, style, agree) for each in parts])
    return made.movedim(1, -1)[:, :height, :width].to(pictures)


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
    """Give a network its weights, of which none will learn."""
    network.load_state_dict(weights, assign=True)
    network.eval().requires_grad_(False)


WEIGHTS = Path(__file__).with_name("picture_style.safetensors")
SIDE = 256
"""Sides of the square that the network looks at, pixels: it was trained on these."""
LEAST = 32
"""Pixels of the shorter side of a picture with a style; of fewer, blurred, comes a blurred one."""
SQUARES = 4
"""Most squares of a long picture: a strip of more is looked at here and there."""
VECTOR = 100
"""Numbers that a style is told by."""
STAGES = ((16, 1, 1), (24, 2, 2), (32, 3, 2), (64, 4, 2), (96, 3, 1), (160, 3, 2), (320, 1, 1))
"""Stages of the MobileNetV2: channels, blocks, and the stride of the first block."""
STYLED = (*(32,) * 10, 16, 8, 3)
"""Channels of each layer of the painting network that has a style."""


class Block(nn.Module):
    """Channels expanded, filtered one by one, and projected."""

    def __init__(self, inputs: int, outputs: int, stride: int, expansion: int) -> None:
        super().__init__()
        inner = inputs * expansion
        self.expand = nn.Conv2d(inputs, inner, 1) if expansion > 1 else None
        self.depthwise = nn.Conv2d(inner, inner, 3, stride, groups=inner)
        self.project = nn.Conv2d(inner, outputs, 1)
        self.kept = stride == 1 and inputs == outputs

    def forward(self, x: Float[Tensor, "v c h w"]) -> Float[Tensor, "v k i j"]:
        y = F.relu6(self.expand(x)) if self.expand else x
        y = self.project(F.relu6(self.depthwise(_margin(y, self.depthwise.stride[0]))))
        return x + y if self.kept else y


class StylePredictor(nn.Module):
    """Pictures to the affine maps of their styles."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(3, 32, 3, 2)
        self.blocks = nn.ModuleList()
        inputs = 32
        for outputs, count, stride in STAGES:
            for k in range(count):
                expansion = 6 if self.blocks else 1
                self.blocks.append(Block(inputs, outputs, 1 if k else stride, expansion))
                inputs = outputs
        self.last = nn.Conv2d(inputs, 1280, 1)
        self.vector = nn.Linear(1280, VECTOR)
        self.gamma, self.beta = (nn.Linear(VECTOR, sum(STYLED)) for _ in range(2))

    def forward(self, x: Float[Tensor, "v 3 256 256"]) -> Float[Tensor, "v 100"]:
        """Return the vectors that tell the styles."""
        x = F.relu6(self.first(_margin(x, 2)))
        for block in self.blocks:
            x = block(x)
        return self.vector(F.relu6(self.last(x)).mean((2, 3)))

    def affine(self, vector: Float[Tensor, "100"]) -> tuple[Affine, ...]:
        """The affine map of each layer of the painting network."""
        gamma, beta = (each(vector).split(STYLED) for each in (self.gamma, self.beta))
        return tuple(map(Affine, gamma, beta))


def _margin(x: Float[Tensor, "v c h w"], stride: int) -> Float[Tensor, "v c i j"]:
    """Zeros around, as TensorFlow pads even sizes: at a stride of 2 to the right and below only."""
    return F.pad(x, (0, 1, 0, 1) if stride == 2 else (1, 1, 1, 1))


@torch.no_grad()
def style_of(picture: Float[Tensor, "h w 3"]) -> tuple[Affine, ...]:
    """The style of a picture, sRGB in [0, 1], for the network of `load_picture_styles`.

    It is the mean over squares that cover the picture: squeezed to one, its strokes would be too.
    Raises InputError for weights that are missing or damaged.
    """
    _, predictor = load_picture_styles()
    return predictor.affine(predictor(_squares(picture)).mean(0))


def _squares(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "n 3 256 256"]:
    """Squares along the longer side of a picture, at most SQUARES."""
    x = picture.float().movedim(-1, 0)[None]
    side, longest = min(x.shape[2:]), max(x.shape[2:])
    starts = torch.linspace(0, longest - side, min(-(-longest // side), SQUARES)).int().tolist()
    axis = 2 if x.shape[2] == longest else 3
    cut = torch.cat([x.narrow(axis, start, side) for start in starts])
    return F.interpolate(cut, (SIDE, SIDE), mode="bilinear", antialias=True).clamp(0, 1)


def read_style_picture(path: Path) -> Float[Tensor, "h w 3"]:
    """A picture to take a style from: upright, over white, at most four times SIDE pixels long.

    Raises InputError where it is no readable picture, UsageError where it is too small.
    """
    width, height = turned_size(path)
    if min(width, height) < LEAST:
        raise UsageError(
            f"{path} has {width}x{height} pixels, too few to have a style: bring one of "
            f"{LEAST} or more a side, best {SIDE} or more"
        )
    size = fitted_size(width, height, 4 * SIDE)
    picture = read_photo(path, turn=True, size=size if size != (width, height) else None)
    return picture if picture.shape[2] == 3 else picture[..., :3] + (1 - picture[..., 3:])


@lru_cache(maxsize=1)
def load_picture_styles(path: Path = WEIGHTS) -> tuple[PaintNetwork, StylePredictor]:
    """Two networks: the one paints in the styles that the other finds in pictures.

    Their weights come with gsedit, and they are kept in memory. Raises InputError where the file is
    missing or damaged.
    """
    with weights_of(path) as weights, torch.random.fork_rng(devices=()):
        network = PaintNetwork(5, contract=(8, 16, 32), expand=(16, 8), folded=True)
        predictor = StylePredictor()
        hold(nn.ModuleDict({"paint": network, "predict": predictor}), weights)
        return network, predictor
