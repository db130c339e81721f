"""Losses between a picture and its target, all differentiable.

Pictures are `h w 3` in [0, 1]; `*n` any leading axes; features `c` channels."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def mse(image: Float[Tensor, "*s"], target: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """Mean squared error over all elements; the color term of eq. (loss)."""
    return _mean((image - target).square())


def l1(image: Float[Tensor, "*s"], target: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """Mean absolute error over all elements."""
    return _mean((image - target).abs())


def ssim(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> Float[Tensor, ""]:
    """Mean structural similarity, in [-1, 1]; sides of 6 pixels or more (reflected at borders)."""
    from kornia.metrics import ssim as ssim_map

    a, b = (t.reshape(-1, *t.shape[-3:]).movedim(-1, 1) for t in (image, target))
    return _mean(ssim_map(a, b, 11, max_val=1.0))  # the window of Wang et al. 2004


def dssim(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> Float[Tensor, ""]:
    """1 - SSIM, in [0, 2]: the "D-SSIM" that 3D Gaussian splatting trains with (weight 0.2).

    The literature's DSSIM is half of this.
    """
    return 1 - ssim(image, target)


def gram(features: Float[Tensor, "*n c h w"]) -> Float[Tensor, "*n c c"]:
    """Correlations of the channels, averaged over positions: divided by h w, and not by c."""
    rows = features.flatten(-2)
    return rows @ rows.mT / rows.shape[-1]


def gram_loss(
    features: list[Float[Tensor, "n _c _h _w"]], targets: list[Float[Tensor, "n _c _h _w"]]
) -> Float[Tensor, ""]:
    """Mean squared difference of Gram matrices, one a picture; summed over layers: the style loss
    of Johnson et al. 2016, whose matrices are divided by c too, but whose squares are summed."""
    return torch.stack(
        [mse(gram(f), gram(t)) for f, t in zip(features, targets, strict=True)]
    ).sum()


def _mean(values: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """The mean, axis by axis: of many values at once, torch's depends on the number of threads."""
    while values.ndim:
        values = values.mean(-1)
    return values
