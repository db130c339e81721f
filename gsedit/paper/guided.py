"""The change that an edit of small pictures made, carried up to the full-size pictures.

`v` pictures, `y x` pixels small, `h w` pixels at full size; colors are sRGB in [0, 1].
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.views.image_ops import downscale

RADIUS = 1
"""Radius of the local maps' windows, in small pixels: of 1, 2 and 4, the nearest to the truth."""


def carry_change(
    edited: Float[Tensor, "v y x 3"],
    original: Float[Tensor, "v y x 3"],
    full: Float[Tensor, "v h w 3"],
) -> Float[Tensor, "v h w 3"]:
    """The full-size pictures with the change from `original` to `edited`.

    `original` is `full` made smaller, or the same view of more pixels: then the change is averaged.
    `edited` itself where both have one size. In every window of
    the small pictures the change is an affine map of colors, by least squares (the guided filter,
    He et al. 2013, eqs. 14-16, with its coefficients interpolated as in the fast guided filter, He
    and Sun 2015); with a ridge towards the slope 1, so that flat windows keep the details that only
    the full size shows. What no such map explains is added, interpolated. An unchanged picture
    stays exactly as it is, but for rounding.
    """
    if edited.shape == full.shape:
        return edited
    if edited.shape[1] > full.shape[1]:
        height, width = full.shape[1:3]
        change = [downscale(each, width, height) for each in edited - original]
        return (full + torch.stack(change)).clamp(0, 1)
    small, guide, goal = (images.movedim(-1, 1) for images in (original, full, edited))
    coefficients = _affine_maps(small, goal)
    rest = goal - _apply(coefficients, small)
    carried = _apply(_enlarge(coefficients, guide), guide) + _enlarge(rest, guide)
    return carried.clamp(0, 1).movedim(1, -1)


def _affine_maps(
    guide: Float[Tensor, "v 3 y x"], goal: Float[Tensor, "v 3 y x"]
) -> Float[Tensor, "v 12 y x"]:
    """The map about every pixel: rows of the slope (output, input), then offsets."""
    mean, mean_goal = _window_mean(guide), _window_mean(goal)
    variance = _window_mean(_products(guide, guide)) - _products(mean, mean)
    covariance = _window_mean(_products(goal, guide)) - _products(mean_goal, mean)
    ridge = 1e-3 * torch.eye(3).to(guide)  # below such a variance of colors the slope stays 1
    variance, covariance = (
        moments.movedim(1, -1).unflatten(-1, (3, 3)) + ridge for moments in (variance, covariance)
    )
    slope = torch.linalg.solve(variance, covariance, left=False)
    slope = slope.flatten(-2).movedim(-1, 1)
    offset = mean_goal - _times(slope, mean)
    return _window_mean(torch.cat((slope, offset), 1))


def _apply(
    coefficients: Float[Tensor, "v 12 h w"], guide: Float[Tensor, "v 3 h w"]
) -> Float[Tensor, "v 3 h w"]:
    return _times(coefficients[:, :9], guide) + coefficients[:, 9:]


def _times(
    slope: Float[Tensor, "v 9 h w"], x: Float[Tensor, "v 3 h w"]
) -> Float[Tensor, "v 3 h w"]:
    """A matrix of each pixel times its color."""
    return (slope.unflatten(1, (3, 3)) * x[:, None]).sum(2)


def _products(a: Float[Tensor, "v 3 y x"], b: Float[Tensor, "v 3 y x"]) -> Float[Tensor, "v 9 y x"]:
    """Products of every channel of `a` with every channel of `b`."""
    return (a[:, :, None] * b[:, None]).flatten(1, 2)


def _window_mean(x: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
    from kornia.filters import box_blur

    side = 2 * RADIUS + 1
    return box_blur(x, (side, side), border_type="replicate", separable=True)


def _enlarge(
    x: Float[Tensor, "v c y x"], like: Float[Tensor, "v b h w"]
) -> Float[Tensor, "v c h w"]:
    """Interpolated between pixel centers; the borders are continued."""
    return F.interpolate(x, like.shape[-2:], mode="bilinear", align_corners=False)
