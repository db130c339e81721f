"""What a picture is compared with where a photo does not say what the scene looks like."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def supervised(
    picture: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None,
) -> tuple[Float[Tensor, "*n h w 3"], Float[Tensor, "*n h w 3"]]:
    """The picture and its target, both with the picture's own colours where the mask is False.

    Any loss of the two is then free of gradients there and of what the photo has there; a window of
    SSIM that reaches across the border compares what lies inside only. Every pixel inside weighs
    what it weighs in a photo without a mask.
    """
    if mask is None:
        return picture, target
    drawn, inside = picture.detach(), mask[..., None]
    return torch.where(inside, picture, drawn), torch.where(inside, target, drawn)
