"""Errors of solvers against the exact path of the ODE.

`v` views, `c y x` latents. Errors are in units of the data's standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.renderer.speed import timed
from gsedit.errors import UsageError
from gsedit.paper.diffusion.sampler import sample
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule, karras_sigmas
from gsedit.paper.diffusion.settings import SamplerSettings, Solver
from research.sampler.measurements import SamplerMeasurement, rms
from research.sampler.mixtures import MixtureProblem, exact_solution, mixture_problem, noised_draw

SOLVERS: tuple[Solver, ...] = ("ddim", "heun", "dpm++2m")
WIDTHS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
GUIDANCE = (1.0, 7.5, 30.0)
STEPS = (5, 10, 20, 40, 80, 160, 320)
FIRST = Schedule.scaled_linear().level(999).sigma


def fine_schedule(last: float, steps: int = 1000) -> Schedule:
    """Unit power, sigmas evenly spaced in their logarithm from `last` to Stable Diffusion's."""
    logs = torch.linspace(math.log(last), math.log(FIRST), steps, dtype=torch.float64)
    return Schedule(1 / (1 + (2 * logs).exp()))


def last_sigma(width: float) -> float:
    """Least noise of the solver studies: a hundredth of the width, so that all of it is
    resolved."""
    return width / 100


def solver_study(
    widths: Iterable[float] = WIDTHS,
    guidance: Iterable[float] = GUIDANCE,
    steps: Iterable[int] = STEPS,
    runs: int = 3,
) -> Iterator[SamplerMeasurement]:
    """Each solver's distance from the ODE's path, by stiffness and number of steps."""
    counts = tuple(steps)
    for width, scale in product(widths, guidance):
        end = last_sigma(width)
        model = mixture_problem(width, schedule=fine_schedule(end))
        settings = _settings(scale)
        first = model.schedule.level_at(FIRST)
        x = noised_draw(model, first)
        exact = exact_solution(model, x, first, settings, end)
        for solver, count in product(SOLVERS, counts):
            # half the steps, as many evaluations: what costs as much stands side by side
            many = max(count // 2, 1) if solver == "heun" else count
            chosen = replace(settings, solver=solver)
            levels = [model.schedule.level_at(s) for s in karras_sigmas(FIRST, end, many + 1)]

            work = partial(_result, model, x, chosen, levels)
            timing, result = timed(work, runs)
            yield SamplerMeasurement(
                "solver",
                f"width {width:g}, guidance {scale:g}",
                solver,
                many,
                evaluations=many * (2 if solver == "heun" else 1),
                seconds=timing.wall,
                error=None if result is None else rms(result / levels[-1].a - exact),
            )


def _settings(scale: float) -> SamplerSettings:
    """With guidance of that scale by the text; at 1, no guidance at all."""
    return SamplerSettings(
        guidance_text=scale, guidance_image=1.0 if scale == 1 else 1.5, strength=1.0
    )


def _result(
    model: MixtureProblem,
    x: Float[Tensor, "v c y x"],
    settings: SamplerSettings,
    levels: list[NoiseLevel],
) -> Float[Tensor, "v c y x"] | None:
    """The last state, or None where the sampler refused to go on."""
    try:
        generator = torch.Generator().manual_seed(0)
        *_, state = sample(model, None, x, settings, levels=levels, generator=generator)
    except UsageError:
        return None
    return state.x
