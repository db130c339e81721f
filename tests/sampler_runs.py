"""Schedules, settings and runs that the tests of the sampler share."""

from __future__ import annotations

import torch
from mixtures import MixtureProblem, noised_draw
from small_scenes import generator

from gsedit.paper.diffusion.guidance import Pair
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings


def rectified_flow(steps: int = 1000, shift: float = 1.0) -> Schedule:
    """x_t = (1 - s) x0 + s noise with s = (t + 1) / steps, up to exactly 1 (Liu et al. 2023).

    `shift` moves the steps towards the noise, as larger pictures need (Esser et al. 2024).
    """
    s = torch.linspace(0, 1, steps + 1, dtype=torch.float64)[1:]
    s = shift * s / (1 + (shift - 1) * s)
    return Schedule((1 - s) ** 2 / ((1 - s) ** 2 + s**2), straight=True)


def zero_terminal_snr(schedule: Schedule) -> Schedule:
    """Schedule with pure noise at its last step, its first unchanged (Lin et al. 2024, alg. 1)."""
    root = schedule.alphas_cumprod.sqrt()
    root = (root - root[-1]) * root[0] / (root[0] - root[-1])
    return Schedule(root**2)


SD = Schedule.scaled_linear()
TERMINAL = zero_terminal_snr(SD)
FLOW = rectified_flow()
SOLVERS = ("ddim", "euler", "heun", "dpm++2m", "ancestral")
UNGUIDED = SamplerSettings(
    guidance_text=1.0, guidance_image=1.0, strength=1.0, spacing="karras", consensus=False
)


def last(states):
    *_, state = states
    return state


def run(model: MixtureProblem, settings: SamplerSettings, **options) -> torch.Tensor:
    """Clean latents from a draw of the noised data."""
    first = levels_of(model.schedule, settings)[0]
    x = noised_draw(model, first, dtype=options.pop("state", torch.float64))
    return last(sample(model, None, x, settings, generator=generator(), **options)).x


def pair(seed: int = 0) -> Pair:
    x0, eps = torch.randn(2, 1, 2, 3, 3, generator=generator(seed), dtype=torch.float64)
    return Pair(x0, eps)
