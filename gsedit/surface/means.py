"""Means over neighbors in space."""

from __future__ import annotations

from jaxtyping import Float, Int
from torch import Tensor


def neighbor_means(
    values: Float[Tensor, "n ..."], rows: Int[Tensor, "n k"], rounds: int
) -> Float[Tensor, "n ..."]:
    """Means of values over each point and its nearest, `rounds` times one after the other."""
    for _ in range(rounds):
        values = (values + values[rows].sum(1)) / (1 + rows.shape[1])
    return values
