"""Quantiles of weighted values. `n` values, `c` columns."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from torch import Tensor


def weighted_quantile(
    values: Float[Tensor, "n c"], weights: Float[Tensor, " n"], share: float
) -> Float[Tensor, " c"]:
    """The least value of each column up to which a share in [0, 1] of the weight lies.

    There is at least one value; without any weight it is the largest.
    """
    ordered, order = values.sort(0)
    below = weights[order].cumsum(0) / weights.sum().clamp_min(1e-12)
    at = (below < share).sum(0).clamp_max(len(values) - 1)
    return ordered.gather(0, at[None])[0]


def extent_of(points: Float[np.ndarray, "n 3"]) -> float:
    """The diagonal of the box that holds all but the outermost 2 % of the points."""
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))
