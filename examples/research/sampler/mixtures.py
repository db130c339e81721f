"""Diffusion models whose probability-flow ODE can be solved to any accuracy: tests of solvers.

`v` views, `k` components of `n` numbers, `c y x` latents. q = x_t / a and sigma = b / a, as in the
solvers. Under each condition the data are a mixture of Gaussians of one width, so that the ODE
becomes stiffer as the width narrows and as guidance, the difference of two scores, grows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.diffusion.guidance import Branches, Need, Prediction, weights
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.closed_form import Mixture

EXACT_STEPS = 10_000
"""Steps of the fourth-order method: its error is then below 1e-10 for every problem here."""
SHAPE = (8, 2, 2, 2)  # views (each a point of its own), channels, cells
SPREAD = 1.0
"""Standard deviation of the components' centers, along each axis: that of the data as a whole."""


@dataclass(frozen=True, eq=False)
class MixtureProblem:
    """A Predictor with exact answers: one mixture of Gaussians under each of the conditions."""

    text_image: Mixture
    image: Mixture
    none: Mixture
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "eps"
    dtype: torch.dtype | None = None
    """Predictions are rounded to it, as a network of that precision would; None: not rounded."""
    name: str = "mixture"

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The exact prediction of the kind `predicts`, under each condition that is needed."""
        level = self.schedule.level(t)
        q = (
            x / level.a if level.a else torch.zeros_like(x)
        )  # no signal: the result is the same for any q
        clean = self.clean(q, level.sigma, need)

        def prediction(x0: Tensor | None) -> Tensor | None:
            return None if x0 is None else self._prediction(x0, x, level)

        return Branches(*map(prediction, clean))

    def clean(self, q: Float[Tensor, "v c y x"], sigma: float, need: Need) -> Branches:
        """E[x0 | q] under each condition that is needed, computed in float64."""
        mixtures = (self.text_image, self.image, self.none)
        return Branches(
            *(
                mixture.posterior_mean(q.double(), sigma**2).to(q) if needed else None
                for mixture, needed in zip(mixtures, need)
            )
        )

    def _prediction(
        self, x0: Float[Tensor, "v c y x"], x: Float[Tensor, "v c y x"], level: NoiseLevel
    ) -> Float[Tensor, "v c y x"]:
        eps = (x - level.a * x0) / level.b
        match self.predicts:
            case "eps":
                predicted = eps
            case "x0":
                predicted = x0
            case "v":
                predicted = level.a * eps - level.b * x0
            case "flow":
                predicted = eps - x0
        return predicted if self.dtype is None else predicted.to(self.dtype)


def mixture_problem(
    width: float,
    *,
    schedule: Schedule | None = None,
    predicts: Prediction = "eps",
    dtype: torch.dtype | None = None,
    shape: tuple[int, int, int, int] = SHAPE,
    seed: int = 0,
) -> MixtureProblem:
    """Three components of that width under text and image, those and three more under the image
    alone, and one of unit variance under neither. Every view has centers of its own.
    """
    generator = torch.Generator().manual_seed(seed)
    centers = SPREAD * torch.randn(6, *shape, generator=generator, dtype=torch.float64)

    def mixture(offsets: Float[Tensor, "k v c y x"], width: float) -> Mixture:
        even = torch.full((shape[0], len(offsets)), -math.log(len(offsets)), dtype=torch.float64)
        return Mixture(torch.zeros(shape, dtype=torch.float64), offsets, even, width)

    return MixtureProblem(
        mixture(centers[:3], width),
        mixture(centers, width),
        mixture(torch.zeros_like(centers[:1]), 1.0),
        schedule or Schedule.scaled_linear(),
        predicts,
        dtype,
    )


def noised_draw(
    model: MixtureProblem, level: NoiseLevel, seed: int = 1, dtype: torch.dtype = torch.float64
) -> Float[Tensor, "v c y x"]:
    """A draw from the first component, noised to a level: where sampling starts."""
    generator = torch.Generator().manual_seed(seed)
    centers = model.text_image.offsets
    noise = torch.randn(2, *centers[0].shape, generator=generator, dtype=torch.float64)
    clean = centers[0] + model.text_image.width * noise[0]
    return (level.a * clean + level.b * noise[1]).to(dtype)


def exact_solution(
    model: MixtureProblem,
    x: Float[Tensor, "v c y x"],
    first: NoiseLevel,
    settings: SamplerSettings,
    last_sigma: float | None = None,
    steps: int = EXACT_STEPS,
) -> Float[Tensor, "v c y x"]:
    """q at `last_sigma` on the guided ODE's path from x, in float64; by default, q without noise.

    By the classical fourth-order Runge-Kutta method in log(sigma), where the ODE of one Gaussian
    has slopes between 0 and 1 however narrow it is. "Without noise" is at a sigma of a
    ten-thousandth of the width: below, q moves by less than 1e-8 widths. The first level must have
    some signal.
    """
    s_T, s_I = settings.scales
    weighted = [
        (weight, mixture)
        for weight, mixture in zip(weights(s_T, s_I), (model.text_image, model.image, model.none))
        if weight != 0
    ]
    parts = [(weight, _components(mixture), mixture.width**2) for weight, mixture in weighted]
    end = 1e-4 * model.text_image.width if last_sigma is None else last_sigma

    def slope(q: Tensor, log_sigma: float) -> Tensor:
        variance = math.exp(2 * log_sigma)
        guided = sum(w * _mean(q, variance, *part, square) for w, part, square in parts)
        return q - guided

    q = x.double().flatten(1) / first.a
    q = _runge_kutta(slope, q, math.log(first.sigma), math.log(end), steps)
    return q.reshape(x.shape)


def _components(mixture: Mixture) -> tuple[Float[Tensor, "v k n"], Float[Tensor, "v k"]]:
    """(centers, log weights) in float64."""
    centers = (mixture.base + mixture.offsets).double().flatten(2).movedim(0, 1)
    return centers.contiguous(), mixture.log_weights.double()


def _mean(
    q: Float[Tensor, "v n"],
    variance: float,
    centers: Float[Tensor, "v k n"],
    log_weights: Float[Tensor, "v k"],
    square: float,
) -> Float[Tensor, "v n"]:
    """E[x0 | q] by the textbook's formula; not Mixture.posterior_mean, which it checks."""
    distance = (q[:, None] - centers).square().sum(-1)
    share = (log_weights - distance / (2 * (square + variance))).softmax(-1)
    center = (share[:, None] @ centers).squeeze(1)
    return center + square / (square + variance) * (q - center)


def _runge_kutta(
    slope: Callable[[Tensor, float], Tensor],
    q: Float[Tensor, "v n"],
    first: float,
    last: float,
    steps: int,
) -> Float[Tensor, "v n"]:
    h = (last - first) / steps
    for i in range(steps):
        u = first + i * h
        k1 = slope(q, u)
        k2 = slope(q + h / 2 * k1, u + h / 2)
        k3 = slope(q + h / 2 * k2, u + h / 2)
        k4 = slope(q + h * k3, u + h)
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return q
