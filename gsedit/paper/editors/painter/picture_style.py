"""The style of any picture: a network that looks at it, and the one that paints so.

Ghiasi, Lee, Kudlur, Dumoulin and Shlens 2017: a MobileNetV2 makes a vector of a picture, and linear
maps make of the vector the scale and offset of each normalised channel of a `PaintNetwork`.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.errors import UsageError
from gsedit.formats.pictures import fitted_size, read_photo, turned_size
from gsedit.paper.editors.painter.network import Affine, PaintNetwork, hold, weights_of

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


class PictureStyles(NamedTuple):
    """Two networks: the one paints in the styles that the other finds in pictures."""

    network: PaintNetwork
    predictor: StylePredictor


@torch.no_grad()
def style_of(picture: Float[Tensor, "h w 3"]) -> tuple[Affine, ...]:
    """The style of a picture, sRGB in [0, 1], for the network of `load_picture_styles`.

    It is the mean over squares that cover the picture: squeezed to one, its strokes would be too.
    Raises InputError for weights that are missing or damaged.
    """
    predictor = load_picture_styles().predictor
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
def load_picture_styles(path: Path = WEIGHTS) -> PictureStyles:
    """The networks with the weights that come with gsedit, kept in memory.

    Raises InputError where the file is missing or damaged.
    """
    with weights_of(path) as weights:
        with torch.device("meta"):
            network = PaintNetwork(5, contract=(8, 16, 32), expand=(16, 8), folded=True)
            found = PictureStyles(network, StylePredictor())
        hold(nn.ModuleDict({"paint": found.network, "predict": found.predictor}), weights)
        return found
