"""Quantiles of weighted values. `n` values, `c` columns."""

from __future__ import annotations

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


def ends(values: Float[Tensor, "n d"], tail: float) -> Float[Tensor, "2 d"]:
    """Begin and end of each column without a share of the values beyond either: stray ones."""
    last = len(values) - 1
    return values.sort(0).values[[int(tail * last), int((1 - tail) * last)]]
