"""Operations on pictures: made smaller without aliasing, turned in hue, padded. `h w` pixels of `c`
channels.

Padding continues pictures, maps and cameras to the right and below, to sides that a number divides.
Nothing is resized for that: a resized picture belongs to another camera, its cells no longer lie
where correspondences were matched, and going back blurs it twice.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

from gsedit.scene.quaternions import axis_rotation
from rasterizer.camera import Camera


def downscale(
    image: Float[Tensor, "h w c"], width: int, height: int
) -> Float[Tensor, "{height} {width} c"]:
    """Average the area under each new pixel, fractions of pixels included: the mean is kept.

    Not torch's "area" interpolation, which averages whole pixels: where a side is no multiple of
    the new one its windows overlap, and the picture is no longer where `Camera.resized` says.
    """
    if (height, width) == tuple(image.shape[:2]):
        return image
    rows = _area_weights(image.shape[0], height)
    columns = _area_weights(image.shape[1], width)
    return torch.einsum("yh,hwc,xw->yxc", rows, image, columns).contiguous()


def _area_weights(old: int, new: int) -> Float[Tensor, "{new} {old}"]:
    """Row i: which part of each old pixel lies under new pixel i; rows sum to 1."""
    edges = torch.arange(new + 1, dtype=torch.float64) * (old / new)
    pixels = torch.arange(old, dtype=torch.float64)
    overlap = torch.minimum(edges[1:, None], pixels + 1) - torch.maximum(edges[:-1, None], pixels)
    return (overlap.clamp_min(0) * (new / old)).float()


def rotate_hue(colors: Float[Tensor, "*n 3"], degrees: float) -> Float[Tensor, "*n 3"]:
    """RGB turned about the grey axis, red towards green; greys stay.

    Not clipped: a color near the border of the cube may leave it.
    """
    rotation = torch.from_numpy(axis_rotation(np.ones(3), degrees))
    return colors @ rotation.T.to(colors)


PadMode = Literal["constant", "edge", "mirror"]
"""constant: one value. edge: the last row and column repeated. mirror: the picture reflected, as
often as it takes; to a network this is neither a streak (as a repeated edge is) nor a frame (as
black is) that it would take for part of the picture."""


def round_up(side: int, multiple: int) -> int:
    """The smallest multiple that is not below `side`."""
    return side + -side % multiple


def pad_camera(camera: Camera, multiple: int) -> Camera:
    """The camera with a picture continued to the right and below; no pixel moves."""
    width, height = (round_up(side, multiple) for side in (camera.width, camera.height))
    return replace(camera, width=width, height=height)


def pad_to_multiple(
    x: Shaped[Tensor, "v h w ..."], multiple: int, mode: PadMode
) -> Shaped[Tensor, "v H W ..."]:
    """Rows and columns continued to a multiple; see `pad_to`."""
    height, width = (round_up(side, multiple) for side in x.shape[1:3])
    return pad_to(x, height, width, mode)


def pad_to(
    x: Shaped[Tensor, "v h w ..."], height: int, width: int, mode: PadMode, value: int | float = 0
) -> Shaped[Tensor, "v H W ..."]:
    """Rows and columns continued to so many, at least as many as `x` has; `value` is what
    `constant` adds. The same tensor where nothing is to add."""
    h, w = x.shape[1:3]
    if (h, w) == (height, width):
        return x
    if mode == "constant":
        padded = x.new_full((len(x), height, width, *x.shape[3:]), value)
        padded[:, :h, :w] = x
        return padded
    rows, columns = _source(h, height, mode), _source(w, width, mode)
    return x[:, rows][:, :, columns]


def _source(side: int, padded: int, mode: PadMode) -> Int[Tensor, " {padded}"]:
    """Index of the row or column that each padded one repeats."""
    index = torch.arange(padded)
    if mode == "edge":
        return index.clamp_max(side - 1)
    index %= 2 * side  # 0 1 ... side-1 side-1 ... 1 0 0 1 ...
    return torch.minimum(index, 2 * side - 1 - index)
