"""A threshold between two kinds of values, from their histogram."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

BINS = 256


def otsu(values: Float[Tensor, " n"], weights: Float[Tensor, " n"]) -> float:
    """The threshold that splits values in [0, 1] into two classes of least variance (Otsu 1979).

    Equivalently, of the greatest variance between the classes' means. Where several thresholds are
    equally good (nothing lies between the classes), the middle one.
    """
    bins = (values.clamp(0, 1) * BINS).long().clamp_max(BINS - 1)
    histogram = torch.zeros(BINS, dtype=torch.float64)
    histogram.index_add_(0, bins, weights.double())
    centres = (torch.arange(BINS, dtype=torch.float64) + 0.5) / BINS
    below = histogram.cumsum(0)[:-1]
    above = histogram.sum() - below
    first = (histogram * centres).cumsum(0)
    mean_below = first[:-1] / below.clamp_min(1e-12)
    mean_above = (first[-1] - first[:-1]) / above.clamp_min(1e-12)
    between = below * above * (mean_above - mean_below).square()
    best = (between >= between.amax() * (1 - 1e-9)).nonzero().squeeze(-1)
    return (float(best.float().mean()) + 1) / BINS
