"""Views whose predictions are biased apart: how far consensus brings them together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from sampler_runs import generator, last

from gsedit.paper.consistency.consensus import consensus
from gsedit.paper.diffusion.guidance import Branches, Prediction, noise_of
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

WIDTHS = torch.tensor([0.003, 0.03, 0.3, 1.0, 3.0], dtype=torch.float64)
"""Widths of the data, one a channel: from detail that is decided last to colors decided first."""
ONE_CLUSTER = torch.zeros(2, 1, 1, dtype=torch.int64)
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Biased:
    """Two views whose x0 is normal about +1 and -1."""

    schedule: Schedule
    predicts: Prediction = "x0"
    name: str = "biased"

    def branches(self, x, t, condition, need):
        level = self.schedule.level(t)
        bias = torch.tensor([1.0, -1.0], dtype=x.dtype).reshape(2, 1, 1, 1)
        power = WIDTHS.reshape(1, -1, 1, 1) ** 2
        kept = power * level.a / (power * level.a**2 + level.b**2)
        x0 = bias + kept * (x - level.a * bias)
        eps = noise_of(x0, x, level)
        predicted = {
            "x0": x0, "eps": eps, "v": level.a * eps - level.b * x0, "flow": eps - x0,
        }[self.predicts]  # fmt: skip
        return Branches(*(predicted if needed else None for needed in need))


def deviation(
    model: Biased,
    settings: SamplerSettings,
    strength: float = 1.0,
    independent: bool = False,
    levels: list[NoiseLevel] | None = None,
) -> torch.Tensor:
    """Signed, of each channel: 1 would be the whole bias, 0 is agreement."""
    draws = torch.randn(2, len(WIDTHS), 1, 1, dtype=torch.float64, generator=generator(1))
    x = draws if independent else draws[:1].expand(2, -1, -1, -1)
    ended = last(
        sample(
            model, None, x, settings, levels=levels, generator=generator(),
            consensus=lambda z: consensus(z, ONE_CLUSTER, strength=strength),
            share=lambda noise: noise[:1].expand(2, -1, -1, -1),
        )
    )  # fmt: skip
    return (ended.x[0] - ended.x[1])[:, 0, 0] / 2


def sweep(
    model: Biased,
    settings: SamplerSettings,
    every: int = 1,
    levels: list[NoiseLevel] | None = None,
    **options: float,
) -> list[torch.Tensor]:
    """The deviation with consensus in no step, in the first one, ..., in all of them."""
    sigmas = [level.sigma for level in (levels or levels_of(model.schedule, settings))[:-1]]
    ends = [2 * sigmas[0] if sigmas[0] < torch.inf else 1e9, *sigmas[1::every], 0.0]
    return [
        deviation(model, replace(settings, t_end=end), levels=levels, **options) for end in ends
    ]


def assert_converges(curve: list[torch.Tensor]) -> None:
    """No deviation changes its sign or grows."""
    values = torch.stack(curve)
    assert (values > -ROUNDING).all()
    assert (values.diff(dim=0) < ROUNDING).all()
