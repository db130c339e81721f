"""The features of the Gram loss: the protocol, and a fixed filter bank.

`n` pictures of `h w` pixels, `c` channels of `y x` positions, kernels of `k k` pixels."""

from __future__ import annotations

from math import sqrt
from typing import Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError


@runtime_checkable
class FeatureExtractor(Protocol):
    """From pictures to feature maps, one a layer; differentiable in the pictures."""

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n c y x"]]:
        """The layers of `images`, which are in [0, 1]."""
        ...


@torch.no_grad()
def with_equal_energy(features: FeatureExtractor) -> FeatureExtractor:
    """The extractor with layers whose channels have the energy of a color on average, on noise of
    the 1/f^2 power spectrum of natural pictures: what FilterBank's have by construction.

    Without this the layers of a network, whose units are arbitrary, weigh in the Gram loss by the
    fourth power of those units.
    """
    picture = _natural_noise()
    energy = (picture - 0.5).square().mean()
    layers = features(picture)
    factors = [float((energy / layer.square().mean()).sqrt()) for layer in layers]
    return lambda images: [k * layer for k, layer in zip(factors, features(images), strict=True)]


def _natural_noise() -> Float[Tensor, "n 3 h w"]:
    """Four pictures of grey-centered 1/f^2 noise in [0, 1], the same at every call."""
    side = SPECTRUM_SIZE
    white = torch.randn(4, 3, side, side, generator=torch.Generator().manual_seed(0))
    f = torch.fft.fftfreq(side)
    radius = (f[:, None].square() + f.square()).sqrt()
    amplitude = torch.where(radius > 0, 1 / radius.clamp_min(1 / side), 0.0)
    noise = torch.fft.ifft2(torch.fft.fft2(white) * amplitude).real
    return (0.5 + 0.2 * noise / noise.std()).clamp(0, 1)  # the contrast of a photo


# ---- a filter bank -------------------------------------------------------------------------------

OPPONENT = (
    (1 / sqrt(3), 1 / sqrt(3), 1 / sqrt(3)),
    (1 / sqrt(2), -1 / sqrt(2), 0.0),
    (1 / sqrt(6), 1 / sqrt(6), -2 / sqrt(6)),
)
"""Luminance, red - green, yellow - blue: an orthonormal basis of RGB, so no color counts twice."""
BINOMIAL = (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16)
"""Low-pass before halving (Burt and Adelson 1983)."""
RADIUS = 3  # pixels; a Gaussian of sigma 1 has 0.3 % of its mass beyond
MIN_SIDE = 8  # pixels; an octave of fewer cannot hold a 7-pixel kernel away from its border
SPECTRUM_SIZE = 64  # pixels; the patch on which energies are made equal: the size that is trained


class FilterBank:
    """Gaussian derivatives of opponent colors in octaves: 12 channels an octave, a layer each.

    Blurred color (3), first derivatives of all three (6), second derivatives of luminance (3);
    derivatives are steerable, so two and three orientations span all. Linear, no weights.
    Each derivative is scaled to pass as much energy of a picture with the 1/f^2 power spectrum of
    natural pictures (Field 1987) as that picture has, and color is measured from mid-grey: the
    channels of one color have energies of one order, in every octave. Chroma is not amplified.
    """

    def __init__(self, octaves: int = 4) -> None:
        if octaves < 1:
            raise UsageError(f"A filter bank of {octaves} octaves sees nothing; use 1 or more.")
        self.octaves = octaves
        self.across, self.down = _kernels()
        self.low_pass = torch.outer(torch.tensor(BINOMIAL), torch.tensor(BINOMIAL))

    def __call__(self, images: Float[Tensor, "n 3 h w"]) -> list[Float[Tensor, "n 12 y x"]]:
        """One layer per octave, the finest first; octaves smaller than 8 pixels are left out."""
        if min(images.shape[-2:]) < MIN_SIDE:
            raise UsageError(
                f"A patch of {images.shape[-1]}x{images.shape[-2]} pixels is too small for the "
                f"filter bank; use patches of {MIN_SIDE} pixels or more."
            )
        # a tenth of the time of a whole kernel, and in this order of memory half of that
        level, layers = images.contiguous(memory_format=torch.channels_last) - 0.5, []
        across, down = self.across.to(images), self.down.to(images)
        low_pass = self.low_pass.to(images).expand(3, 1, -1, -1)
        for _ in range(self.octaves):
            if min(level.shape[-2:]) < MIN_SIDE:
                break
            padded = F.pad(level, (RADIUS,) * 4, mode="reflect")
            layers.append(F.conv2d(F.conv2d(padded, across), down))
            level = F.conv2d(F.pad(level, (2,) * 4, mode="reflect"), low_pass, stride=2, groups=3)
        return layers


def _kernels() -> tuple[Float[Tensor, "7 3 1 k"], Float[Tensor, "12 7 k 1"]]:
    """Color and rows, of which the second makes channels by columns."""
    t = torch.arange(-RADIUS, RADIUS + 1, dtype=torch.float64)
    gauss = torch.exp(-t.square() / 2) / torch.exp(-t.square() / 2).sum()
    first, second = -t * gauss, (t.square() - 1) * gauss
    second = second - gauss * second.sum()  # sampling leaves a mean; a flat picture has no edges
    lines, colors = (gauss, first, second), torch.tensor(OPPONENT, dtype=torch.float64)
    rows = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0), (2, 1)]  # color, order of derivative
    across = torch.stack([colors[c, :, None] * lines[k] for c, k in rows])
    shapes = [(c, *k) for c in range(3) for k in ((0, 0), (0, 1), (1, 0))]  # down, across
    shapes += [(0, *k) for k in ((0, 2), (1, 1), (2, 0))]
    down = torch.zeros(len(shapes), len(rows), len(t), dtype=torch.float64)
    for channel, (c, y, x) in enumerate(shapes):
        gain = _gain(torch.outer(lines[y], lines[x])) if x or y else 1.0
        down[channel, rows.index((c, x))] = gain * lines[y]
    return across[:, :, None], down[..., None]


def _gain(kernel: Float[Tensor, "k k"]) -> float:
    """The factor by which it passes the energy of a 1/f^2 picture unchanged (Parseval)."""
    f = torch.fft.fftfreq(SPECTRUM_SIZE, dtype=torch.float64)
    squared = f[:, None].square() + f.square()
    power = torch.where(squared > 0, 1 / squared, 0.0)
    gain = torch.fft.fft2(kernel, s=(SPECTRUM_SIZE, SPECTRUM_SIZE)).abs().square()
    return float((power.sum() / (gain * power).sum()).sqrt())
