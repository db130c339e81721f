"""Predictions of a network, as the pair (x0, eps) that solvers work with.

Of x_t = a x0 + b noise, a network may predict the noise, the clean latent, or one of two
combinations. Each is a linear map of the pair, and with x_t = a x0 + b eps it is solved for both.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.schedules import NoiseLevel

Latents = Float[Tensor, "v c y x"]
Prediction = Literal["eps", "x0", "v", "flow"]
"""eps: the noise. x0: the clean latent. v = a eps - b x0 (Salimans and Ho 2022). flow = eps - x0,
the velocity dx/ds of a straight path (Liu et al. 2023)."""


class Pair(NamedTuple):
    """Two predictions that belong together: x_t = a x0 + b eps."""

    x0: Latents
    eps: Latents


def as_pair(
    kind: Prediction,
    predicted: Latents,
    x: Latents,
    level: NoiseLevel,
) -> Pair:
    """(x0, eps) of a prediction at x_t. Raises UsageError for eps where nothing is left of x0."""
    a, b = level.a, level.b
    match kind:
        case "eps":
            return Pair(clean_of(predicted, x, level), predicted)
        case "x0":
            return Pair(predicted, noise_of(predicted, x, level))
        case "v":
            unit = a * a + b * b
            return Pair((a * x - b * predicted) / unit, (b * x + a * predicted) / unit)
        case "flow":
            return Pair((x - b * predicted) / (a + b), (x + a * predicted) / (a + b))


def clean_of(eps: Latents, x: Latents, level: NoiseLevel) -> Latents:
    """x0 that belongs to x_t and eps. Raises UsageError where a is 0: x_t holds nothing of it."""
    if level.a == 0:
        raise UsageError(
            f"at t = {level.t:g} the terminal SNR is 0: a prediction of the noise says nothing of "
            "the picture there. Use strength below 1, a schedule that ends above 0, or a network "
            "that predicts v, x0 or flow"
        )
    return (x - level.b * eps) / level.a


def noise_of(x0: Latents, x: Latents, level: NoiseLevel) -> Latents:
    """eps that belongs to x_t and x0; b must not be 0."""
    return (x - level.a * x0) / level.b
