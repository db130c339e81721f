"""Schedules, settings and runs that the tests of the sampler share."""

from __future__ import annotations

import torch

from gsedit.bench.sampler.mixtures import MixtureProblem, noised_draw
from gsedit.diffusion import Pair, SamplerSettings, Schedule, levels_of, sample

SD = Schedule.scaled_linear()
TERMINAL = SD.zero_terminal_snr()
FLOW = Schedule.rectified_flow()
SOLVERS = ("ddim", "euler", "heun", "dpm++2m", "ancestral")
UNGUIDED = SamplerSettings(
    guidance_text=1.0, guidance_image=1.0, strength=1.0, spacing="karras", consensus=False
)


def last(states):
    *_, state = states
    return state


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def run(model: MixtureProblem, settings: SamplerSettings, **options) -> torch.Tensor:
    """Clean latents from a draw of the noised data."""
    first = levels_of(model.schedule, settings)[0]
    x = noised_draw(model, first, dtype=options.pop("state", torch.float64))
    return last(sample(model, None, x, settings, generator=generator(), **options)).x


def pair(seed: int = 0) -> Pair:
    x0, eps = torch.randn(2, 1, 2, 3, 3, generator=generator(seed), dtype=torch.float64)
    return Pair(x0, eps)
