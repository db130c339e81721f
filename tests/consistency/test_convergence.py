"""Consensus leads to agreement and never beyond it.

Views that start from the same noise, each pulled by a bias of its own, deviate from their mean by a
signed number. The longer consensus acts, the smaller it gets; it reaches 0 and never changes its
sign: at every solver, parameterisation, schedule, number of steps, and noise level at which
consensus ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from mixtures import predicted
from sampler_runs import FLOW, SD, SOLVERS, TERMINAL, generator, last

from gsedit.paper.consistency.consensus import consensus
from gsedit.paper.diffusion.guidance import Branches, Prediction
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

TIMES = torch.arange(1, 1001, dtype=torch.float64) / 1001
COSINE = Schedule(1 / (1 + (4 * (TIMES * torch.pi / 2).tan()) ** 2))
"""sigma = 4 tan(pi t / 2), shifted toward the noise as schedules of large pictures are."""


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
        found = predicted(self.predicts, x0, x, level)
        return Branches(*(found if needed else None for needed in need))


def deviation(model: Biased, settings: SamplerSettings, independent: bool = False) -> torch.Tensor:
    """Signed, of each channel: 1 would be the whole bias, 0 is agreement."""
    draws = torch.randn(2, len(WIDTHS), 1, 1, dtype=torch.float64, generator=generator(1))
    x = draws if independent else draws[:1].expand(2, -1, -1, -1)
    ended = last(
        sample(
            model, None, x, settings, generator=generator(),
            consensus=lambda z: consensus(z, ONE_CLUSTER),
            share=lambda noise: noise[:1].expand(2, -1, -1, -1),
        )
    )  # fmt: skip
    return (ended.x[0] - ended.x[1])[:, 0, 0] / 2


def sweep(model: Biased, settings: SamplerSettings, every: int = 1, **options):
    """The deviation with consensus in no step, in the first one, ..., in all of them."""
    sigmas = [level.sigma for level in levels_of(model.schedule, settings)[:-1]]
    ends = [2 * sigmas[0] if sigmas[0] < torch.inf else 1e9, *sigmas[1::every], 0.0]
    return [deviation(model, replace(settings, t_end=end), **options) for end in ends]


def assert_converges(curve: list[torch.Tensor]) -> None:
    """No deviation changes its sign or grows."""
    values = torch.stack(curve)
    assert (values > -ROUNDING).all()
    assert (values.diff(dim=0) < ROUNDING).all()


def unguided(solver, steps: int, **more) -> SamplerSettings:
    return SamplerSettings(
        steps=steps, solver=solver, guidance_text=1.0, guidance_image=1.0, strength=1.0, **more
    )


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("schedule", "predicts", "steps"),
    [
        (SD, "eps", 10), (SD, "eps", 23), (SD, "eps", 100), (COSINE, "v", 20),
        (FLOW, "flow", 10), (FLOW, "flow", 50), (TERMINAL, "v", 20),
    ],
    ids=["sd-10", "sd-23", "sd-100", "cosine-20", "flow-10", "flow-50", "terminal-20"],
)  # fmt: skip
def test_the_deviation_falls_to_agreement_and_never_beyond(schedule, predicts, solver, steps):
    spacing = "leading" if schedule in (SD, FLOW) else "trailing"
    model = Biased(schedule, predicts)
    curve = sweep(model, unguided(solver, steps, spacing=spacing), every=max(steps // 8, 1))
    assert curve[0].amax() > 0.9  # there is something to agree on
    assert_converges(curve)
    torch.testing.assert_close(curve[-1], torch.zeros(len(WIDTHS), dtype=torch.float64))


@pytest.mark.parametrize("solver", ["ddim", "euler"])
def test_the_noise_that_views_do_not_share_is_not_amplified(solver):
    """Independent noise has a deviation of its own, of either sign: its share is what remains when
    the biases, which are the same in both, are subtracted."""
    settings = unguided(solver, 20)
    apart = sweep(Biased(SD), settings, independent=True)
    together = sweep(Biased(SD), settings)
    own = torch.stack(apart) - torch.stack(together)
    assert_converges([row * own[0].sign() for row in own])


@pytest.mark.parametrize("target", ["x0", "xt", "eps"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_where_views_agree_already_nothing_changes(solver, target):
    """Not even the last bit, so cells in no cluster are sampled as if there were none."""
    x = torch.randn(2, len(WIDTHS), 1, 1, dtype=torch.float64, generator=generator(1))
    settings = unguided(solver, 20, t_end=0.0, target=target)
    alone, agreed = (
        last(sample(Biased(SD), None, x, settings, consensus=agree, generator=generator())).x
        for agree in (None, lambda z: z)
    )
    # x0 is found again from eps, with one rounding more
    torch.testing.assert_close(agreed, alone, rtol=1e-7 if target == "eps" else 0, atol=0)
