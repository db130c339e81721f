"""The response of a random camera: defocus, exposure, white balance, haze, a tone curve, noise."""

from __future__ import annotations

from math import ceil

import torch
from jaxtyping import Float
from kornia.filters import gaussian_blur2d
from torch import Tensor

from research.train_small.pictures.random_stream import RandomStream


def camera_response(
    rgb: Float[Tensor, "h w 3"], subject: Float[Tensor, "h w 1"], rng: RandomStream
) -> Float[Tensor, "h w 3"]:
    """sRGB in [0, 1] of linear rgb; defocus, if any, spares the subject (a share in [0, 1])."""
    if rng.chance(0.3):
        rgb = _defocused(rgb, subject, rng(0.5, 4.0) * len(rgb) / 128)
    middle = rgb.mean(-1).flatten().median().clamp_min(0.02)
    exposed = rgb * (rng(0.14, 0.6) / middle) ** rng(0.5, 1.0)
    balanced = exposed * torch.tensor([rng(0.9, 1.11) for _ in range(3)])
    hazy = balanced + rng(0, 0.04) ** 1.5
    shown = (hazy / (1 + 0.25 * hazy)).clamp_min(1e-4) ** (1 / rng(1.9, 2.5))
    noise = torch.randn(rgb.shape, generator=rng.generator)
    return (shown + rng(0, 0.17) ** 2 * noise).clamp(0, 1)


def _defocused(
    rgb: Float[Tensor, "h w 3"], subject: Float[Tensor, "h w 1"], sigma: float
) -> Float[Tensor, "h w 3"]:
    """All but the subject blurred by `sigma` pixels, without its colors bleeding out."""
    behind = 1 - subject
    blurred = _blurred(torch.cat((rgb * behind, behind), -1), sigma)
    return rgb * subject + blurred[..., :3] / blurred[..., 3:].clamp_min(1e-3) * behind


def _blurred(planes: Float[Tensor, "h w c"], sigma: float) -> Float[Tensor, "h w c"]:
    """Convolved with a Gaussian of `sigma` pixels; the border is replicated."""
    side = 2 * max(ceil(2.5 * sigma), 1) + 1
    stack = gaussian_blur2d(planes.movedim(-1, 0)[None], side, (sigma, sigma), "replicate")
    return stack[0].movedim(0, -1)
