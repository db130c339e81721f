"""How good an edit is, in numbers: error, structure, strength.

Pictures of `h w` pixels in [0, 1]; an error is the RMSE of their colors, mean over pixels *and*
channels. The interval of a number that is pooled over views is a bootstrap that draws whole views:
what belongs to one shares its exposure, noise and place. It tells how far the number would move
with other views of the same scene and edit, not with another seed or scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.measures import losses
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.perceptual import SMALLEST, perceptual_distance

NEAREST = 100.0
"""dB that equal pictures get, an RMSE of 1e-5, since numbers in JSON are finite."""


INSIDE = 0.5
"""Least share of a pixel that comes from the region's Gaussians: the others are outside it, where
leakage is measured."""


class SquaredError(NamedTuple):
    """Squared error of colors, to be pooled over pictures of any sizes."""

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
    # by NumPy: torch's sum depends on the number of threads
    total = difference.square().detach().numpy().sum()
    return SquaredError(float(total), difference.numel())


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


def nearness(
    image: Float[Tensor, "h w 3"],
    expected: Float[Tensor, "h w 3"],
    mask: Bool[Tensor, "h w"] | None = None,
) -> float:
    """PSNR, dB, inside the mask; NEAREST for equal pictures. UsageError for an empty mask."""
    return min(psnr(image, expected, mask), NEAREST)


@torch.no_grad()
def ssim(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> float:
    """Structural similarity, in [-1, 1], 1 when equal; sides of 6 pixels or more.

    Where the mask is False nothing is expected, and windows take the picture for both.
    """
    return losses.ssim(image, _inside(mask, target, image)).item()


@torch.no_grad()
def perceptual(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    mask: Bool[Tensor, "*n h w"] | None = None,
) -> float | None:
    """Learned perceptual distance: 0 for equal pictures, about 1 for unrelated ones; where the mask
    is False the picture is taken for both.

    None without the package of its weights (`gsedit[perceptual]`), and for pictures of fewer than
    32 pixels a side.
    """
    distance = perceptual_distance()
    if distance is None or min(image.shape[-3:-1]) < SMALLEST:
        return None
    return distance(image, _inside(mask, target, image)).item()


def _inside(mask: Tensor | None, target: Tensor, image: Tensor) -> Tensor:
    """The target, with the picture itself where nothing is expected."""
    return target if mask is None else torch.where(mask[..., None], target, image)


Interval = tuple[float, float]
"""The middle 95 % of the draws, and more where views are few."""
FEWEST_VIEWS = 4
"""Fewest views that have an interval: three can be drawn in ten ways only."""


def interval(
    sums: Sequence[Sequence[float | int]],
    views: Sequence[Sequence[int]],
    value: Callable[[Float[np.ndarray, "k d"]], Float[np.ndarray, " d"]],
) -> Interval | None:
    """The interval of value(total of `sums`); None below FEWEST_VIEWS views.

    A row of `sums` is the part of what belongs to the same row of `views`: one view, or the two of
    a pair, which comes as often as the product of its views' draws (Snijders and Borgatti 1999).
    `value` gets the `k` columns of sums, each for `d` draws. The same input has the same interval.
    """
    known = {view: k for k, view in enumerate(sorted({v for row in views for v in row}))}
    if len(known) < FEWEST_VIEWS:
        return None
    random = np.random.default_rng(0)
    # more than 2,000 draws move the ends by less than a hundredth of the length
    drawn = random.multinomial(len(known), np.full(len(known), 1 / len(known)), 2000)
    times = np.stack([drawn[:, [known[v] for v in row]].prod(1) for row in views], 1)
    times = times[times.any(1)]  # draws in which no pair has both of its views tell nothing
    tail = tail_of(len(known))
    drawn_values = value((times @ np.asarray(sums, float)).T)
    low, high = np.quantile(drawn_values, [tail, 1 - tail])
    return float(low), float(high)


def tail_of(units: int) -> float:
    """The share of draws beyond each end of an interval, where so many units, 2 or more, are drawn.

    Expanded percentiles (Hesterberg 2015): plain ones of few units are too narrow, by
    sqrt((n - 1) / n) and as the normal distribution is to Student's t.
    """
    from scipy.special import ndtr, stdtrit  # scipy.stats takes 0.3 s and 45 MB to import

    wide = np.sqrt(units / (units - 1)) * stdtrit(units - 1, 0.975)
    return float(ndtr(-wide))


def mean_interval(values: Sequence[float]) -> Interval | None:
    """The interval of a mean over views, one value each."""
    rows = [(value, 1.0) for value in values]
    return interval(rows, [(i,) for i in range(len(rows))], lambda sums: sums[0] / sums[1])
