"""Diffusion models whose probability-flow ODE can be solved to any accuracy: tests of solvers.

`v` views, `c y x` latents. q = x_t / a and sigma = b / a, as in the solvers. Under each condition
the data are a mixture of Gaussians of one width, so that the ODE becomes stiffer as the width
narrows and as guidance, the difference of two scores, grows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from scipy.integrate import solve_ivp
from torch import Tensor

from gsedit.paper.diffusion.guidance import Branches, Need, Prediction
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.editors.closed_form import Mixture

SHAPE = (8, 2, 2, 2)  # views (each a point of its own), channels, cells


def predicted(kind: Prediction, x0: Tensor, x: Tensor, level: NoiseLevel) -> Tensor:
    """The prediction of a network of that kind for x, where the clean latents are x0."""
    eps = (x - level.a * x0) / level.b
    kinds = {"eps": eps, "x0": x0, "v": level.a * eps - level.b * x0, "flow": eps - x0}
    return kinds[kind]


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

    def branches(self, x: Tensor, t: float, condition: Any, need: Need) -> Branches:
        """The exact prediction of the kind `predicts`, under each condition that is needed."""
        level = self.schedule.level(t)
        # no signal: the result is the same for any q
        q = x / level.a if level.a else torch.zeros_like(x)

        def under(mixture: Mixture) -> Tensor:
            x0 = mixture.posterior_mean(q.double(), level.sigma**2).to(q)
            return predicted(self.predicts, x0, x, level).to(self.dtype or x.dtype)

        mixtures = (self.text_image, self.image, self.none)
        return Branches(*(under(each) if needed else None for each, needed in zip(mixtures, need)))


def mixture_problem(
    width: float,
    *,
    schedule: Schedule | None = None,
    predicts: Prediction = "eps",
    dtype: torch.dtype | None = None,
    shape: tuple[int, int, int, int] = SHAPE,
) -> MixtureProblem:
    """Three components of that width under text and image, those and three more under the image
    alone, and one of unit variance under neither. Every view has centers of its own.
    """
    generator = torch.Generator().manual_seed(0)
    centers = torch.randn(6, *shape, generator=generator, dtype=torch.float64)

    def mixture(offsets: Tensor, width: float) -> Mixture:
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
    model: MixtureProblem, level: NoiseLevel, dtype: torch.dtype = torch.float64
) -> Tensor:
    """A draw from the first component, noised to a level: where sampling starts."""
    generator = torch.Generator().manual_seed(1)
    centers = model.text_image.offsets
    noise = torch.randn(2, *centers[0].shape, generator=generator, dtype=torch.float64)
    clean = centers[0] + model.text_image.width * noise[0]
    return (level.a * clean + level.b * noise[1]).to(dtype)


def exact_solution(
    model: MixtureProblem, x: Tensor, first: NoiseLevel, last_sigma: float
) -> Tensor:
    """q at `last_sigma` on the unguided ODE's path from x, in float64.

    By an eighth-order method in log(sigma), where the ODE of one Gaussian has slopes between 0 and
    1 however narrow it is. The first level must have some signal.
    """

    def slope(log_sigma: float, q: Any) -> Any:
        points = torch.from_numpy(q).reshape(x.shape)
        clean = model.text_image.posterior_mean(points, math.exp(2 * log_sigma))
        return (points - clean).flatten().numpy()

    span = math.log(first.sigma), math.log(last_sigma)
    start = (x.double() / first.a).flatten().numpy()
    found = solve_ivp(slope, span, start, method="DOP853", rtol=1e-12, atol=1e-12)
    return torch.from_numpy(found.y[:, -1]).reshape(x.shape)
