"""Laws that every model in diffusers' layout obeys; its own test file calls each."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import torch
from closeness import EPS32

from gsedit.paper.consistency.consensus import consensus
from gsedit.paper.diffusion.sampler import SamplerStep, sample
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.protocol import levels_for
from gsedit.paper.models.model import Model

PROMPT = "make it snow"


@torch.no_grad()
def run(
    model: Model, pictures: torch.Tensor, start: torch.Tensor, settings: SamplerSettings, **options
) -> Iterator[SamplerStep]:
    """The sampler's steps from this noise, at the model's own levels and guidance."""
    settings = settings.with_defaults(model.capabilities.defaults)
    condition = model.condition(pictures, PROMPT, torch.Generator())
    levels = levels_for(model, settings, (start.shape[2], start.shape[3]))
    return sample(model, condition, start, settings, levels=levels, **options)


def consensus_law_holds(model: Model, pictures: torch.Tensor, start: torch.Tensor) -> None:
    """The deviation of corresponding cells never changes its sign and never grows."""
    views, _, *cells = start.shape
    numbers = torch.arange(cells[0] * cells[1]).reshape(1, *cells)
    agree = partial(consensus, labels=numbers.expand(views, -1, -1))
    for solver in ("euler", "dpm++2m"):
        settings = SamplerSettings(steps=4, strength=1.0, solver=solver, t_end=0.0)
        steps = [
            start,
            *(step.x for step in run(model, pictures, start, settings, consensus=agree)),
        ]
        deviations = [x - x.mean(0) for x in steps]
        largest = max(float(x.abs().max()) for x in steps)
        rounding = 10 * EPS32 * largest  # a step rounds a few times
        for before, after in pairwise(deviations):
            assert (after.abs() <= before.abs() + rounding).all()
            assert (after * before.sign() >= -rounding).all()
        assert deviations[-1].abs().max() <= rounding
