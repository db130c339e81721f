"""How good an edit is, in numbers: error, structure, agreement between views, strength, leakage.

`v` views of `h w` pixels, `m` pairs of views. Pictures in [0, 1]; an error is the RMSE of their
colours, mean over pixels *and* channels."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import nan, sqrt
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.consistency.warp import warp
from gsedit.errors import UsageError
from gsedit.measures import losses
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.perceptual import SMALLEST, perceptual_distance
from rasterizer.camera import Camera

NEAREST = 100.0
"""dB that equal pictures get, an RMSE of 1e-5, since numbers in JSON are finite."""


INSIDE = 0.5
"""Least share of a pixel that comes from the region's Gaussians: the others are outside it, where
leakage is measured."""


class SquaredError(NamedTuple):
    """Of colours: to be pooled over pictures of any sizes."""

    total: float
    values: int
    """Numbers that were compared: pixels times channels."""


def squared_error(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> SquaredError:
    """The sum of squared differences inside the mask, and how many there are."""
    difference = (image - target).double()
    if mask is not None:
        difference = difference[mask]
    return SquaredError(difference.square().sum().item(), difference.numel())


def pooled_rmse(errors: Iterable[SquaredError]) -> float | None:
    """Root mean squared error over all compared values; None where there are none."""
    total, values = (sum(each) for each in zip((0.0, 0), *errors))
    return sqrt(total / values) if values else None


def rmse(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> float:
    """Root mean squared error inside the mask; UsageError if it is empty."""
    error = pooled_rmse([squared_error(image, target, mask)])
    if error is None:
        raise UsageError("The mask selects no pixel, so there is nothing to measure; enlarge it.")
    return error


def psnr(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> float:
    """Peak signal-to-noise ratio, dB, of the mean error of all pictures; inf when equal."""
    return psnr_from_rmse(rmse(image, target, mask))


@torch.no_grad()
def ssim(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> float:
    """Structural similarity, in [-1, 1], 1 when equal."""
    return losses.ssim(image, target).item()


@torch.no_grad()
def perceptual(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> float | None:
    """Learned perceptual distance: 0 for equal pictures, about 1 for unrelated ones.

    None without the package of its weights (`gsedit[perceptual]`), and for pictures of fewer than
    32 pixels a side.
    """
    distance = perceptual_distance()
    if distance is None or min(image.shape[-3:-1]) < SMALLEST:
        return None
    return distance(image, target).item()


def edit_strength(
    original: Float[Tensor, "*n h w 3"],
    edited: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> float:
    """RMSE between the edited and the original pictures, inside the mask (what was to be edited).

    Report it beside the warp error: a scene that was not edited at all is perfectly consistent.
    """
    return rmse(edited, original, mask)


def leakage(
    original: Float[Tensor, "*n h w 3"],
    edited: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"],
) -> float:
    """RMSE between the edited and the original pictures, outside the mask: 0 is best."""
    return rmse(edited, original, ~mask)


@dataclass(frozen=True)
class Fidelity:
    """How near pictures are to those that were expected: means over the pictures."""

    psnr: float
    """dB, higher is nearer; NEAREST for equal pictures."""
    ssim: float
    perceptual: float | None
    """None without its weights."""


def fidelity(
    image: Float[Tensor, "h w 3"],
    expected: Float[Tensor, "h w 3"],
    mask: Bool[Tensor, "h w"] | None = None,
) -> Fidelity:
    """Of one picture of 6 pixels or more a side.

    Where the mask is False nothing is expected: the PSNR is that of the other pixels, and what has
    windows takes the picture for both there. UsageError for a mask without True.
    """
    decibels = min(psnr(image, expected, mask), NEAREST)
    if mask is not None:
        expected = torch.where(mask[..., None], expected, image)
    return Fidelity(decibels, ssim(image, expected), perceptual(image, expected))


@dataclass(frozen=True, eq=False)
class WarpError:
    """How far views differ in colour where they show the same surface."""

    pairs: tuple[tuple[int, int], ...]
    rmse: tuple[float, ...]
    """Per pair, over the pixels that both see; nan where there are none."""
    coverage: tuple[float, ...]
    """Per pair, fraction of view a's pixels that were compared. An error over 1 % means little."""

    @property
    def mean(self) -> float:
        """RMSE over all compared pixels of all pairs; nan if there are none."""
        total = sum(self.coverage)
        square = sum(c * e**2 for c, e in zip(self.coverage, self.rmse) if c)
        return sqrt(square / total) if total else nan


@torch.no_grad()
def warp_error(
    images: Float[Tensor, "v h w 3"],
    cameras: Sequence[Camera],
    depths: Float[Tensor, "v h w"],
    alphas: Float[Tensor, "v h w"],
    pairs: Sequence[tuple[int, int]] | None = None,
) -> WarpError:
    """Each pair's RMSE between view a and view b warped into a, where `correspond.warp` is valid.

    `pairs` defaults to every pair once. On a camera path, short range is (t, t - 1) and long range
    (t, t - 7). Depths are the unedited scene's, in world units along the view,
    unless the edit moved the geometry. Compare with the same number for the unedited pictures:
    shading and resampling make it more than zero.
    """
    pairs = tuple(pairs or itertools.combinations(range(len(images)), 2))
    errors, coverage = [], []
    views = list(zip(cameras, depths, alphas, strict=True))
    for a, b in pairs:
        warped, valid = warp(images[b], *views[a], *views[b])
        errors.append(rmse(warped, images[a], valid) if valid.any() else nan)
        coverage.append(valid.double().mean().item())
    return WarpError(pairs, tuple(errors), tuple(coverage))
