"""Operations on pictures: made smaller without aliasing, turned in hue.

`h w` pixels of `c` channels."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.quaternions import axis_rotation


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
