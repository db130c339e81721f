"""The sampler: guidance, consensus and a solver, as a generator of steps.

`v` views, `c` channels, `y x` latent cells.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import log
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import (
    Guided,
    Latents,
    Pair,
    Prediction,
    Predictor,
    as_pair,
    check_finite,
    clean_of,
    noise_of,
)
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

Predict = Callable[[Latents, NoiseLevel], Pair]
"""The guided prediction at x_t."""


def straight_on(pair: Pair, there: NoiseLevel) -> Latents:
    """Euler's step, and DDIM's: the same x0 and eps at another level."""
    return there.a * pair.x0 + there.b * pair.eps


def ancestral(
    pair: Pair, here: NoiseLevel, there: NoiseLevel, eta: float, noise: Latents
) -> Latents:
    """Eqs. 12 and 16 of DDIM (Song et al. 2021) at any scale: part of the noise is drawn anew.

    With unit variance and eta = 1 it is k-diffusion's Euler ancestral step.
    """
    kept = there.b * here.a / (there.a * here.b)  # sigma' / sigma
    fresh = eta * max(1 - kept**2, 0.0) ** 0.5
    eps = (1 - fresh**2) ** 0.5 * pair.eps + fresh * noise
    return there.a * pair.x0 + there.b * eps


def heun(pair: Pair, here: NoiseLevel, there: NoiseLevel, predict: Predict) -> Latents:
    """Trapezoidal rule (Karras et al. 2022, alg. 1): Euler's step, corrected at its end.

    It costs a second prediction, but for a last step to no noise, which is Euler's. Where a is 0 it
    is the same rule in 1 / sigma.
    """
    ahead = straight_on(pair, there)
    if there.b == 0 or there == here:
        return ahead
    corrector = predict(ahead, there)
    if here.a == 0:
        return ahead + there.a / 2 * (corrector.x0 - pair.x0)
    return ahead + (there.b - there.a * here.b / here.a) / 2 * (corrector.eps - pair.eps)


class PreviousStep(NamedTuple):
    """Start of the previous step, and the prediction there."""

    level: NoiseLevel
    x0: Latents


def multistep(
    pair: Pair, here: NoiseLevel, there: NoiseLevel, previous: PreviousStep | None
) -> Latents:
    """DPM-Solver++(2M) (Lu et al. 2023, alg. 2), written as Euler's step and a correction.

    Its time is lambda = log(a / b). The first step, and the last to no noise, are Euler's; so is
    any step whose predecessor began at a = 0, infinitely far away.
    """
    ahead = straight_on(pair, there)
    if previous is None or previous.level.a == 0 or previous.level == here:
        return ahead
    if there.b == 0 or there == here:
        return ahead
    before = log(previous.level.sigma / here.sigma)
    ratio = log(here.sigma / there.sigma) / before
    return ahead + (there.a - here.a * there.b / here.b) * ratio / 2 * (pair.x0 - previous.x0)


Hook = Callable[[Latents], Latents]
"""A linear map of latents that makes corresponding cells agree."""


@dataclass(frozen=True, eq=False)
class SamplerStep:
    """The latents after one step of the sampler."""

    step: int
    """Number of the step, 1 to `steps`."""
    steps: int
    t: float
    """The noise level that `x` has reached; 0 at the end."""
    x: Float[Tensor, "v c y x"]
    """Noisy latents x_t of all views."""
    x0: Float[Tensor, "v c y x"]
    """The clean latents that this step moved towards."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """Views whose x0 is given, so that the denoiser is not run for them."""

    views: Bool[Tensor, " v"]
    x0: Float[Tensor, "v c y x"]
    """Only the rows of `views` are read."""


def add_noise(
    x0: Float[Tensor, "v c y x"], noise: Float[Tensor, "v c y x"], level: NoiseLevel
) -> Float[Tensor, "v c y x"]:
    """x_t of clean latents: where sampling starts."""
    return level.a * x0 + level.b * noise


def levels_of(schedule: Schedule, settings: SamplerSettings) -> list[NoiseLevel]:
    """The `steps` + 1 levels between which these settings step; the first is where x starts."""
    # Stable Diffusion's own DDIM ends with the little noise of step 0 (set_alpha_to_one false)
    ends_at_zero = settings.method == "ddim" and settings.step_spacing == "leading"
    return schedule.levels(
        settings.step_count, settings.strength, settings.step_spacing, clean=not ends_at_zero
    )


def sample(
    denoiser: Predictor,
    condition: Any,
    x: Float[Tensor, "v c y x"],
    settings: SamplerSettings,
    *,
    levels: Sequence[NoiseLevel] | None = None,
    consensus: Hook | None = None,
    share: Hook | None = None,
    anchor: Anchor | None = None,
    generator: torch.Generator | None = None,
) -> Iterator[SamplerStep]:
    """Denoise `x`, latents at the first of the levels, to the last; yields every step.

    `consensus` acts on `settings.target` while sigma is above t_end; with all of its strength, the
    deviation of corresponding cells then never changes its sign and never grows, whatever the
    solver. `share` acts on fresh noise, which only eta > 0 and `ancestral` draw (from
    `generator`, then required). `condition` is that of the views that are not anchored, in their
    order. `levels` overrule the settings' steps.
    The state keeps the dtype of `x`, float32 or float64, whatever the network computes in. Raises
    UsageError, also where a number stops being finite: it names the settings that did it.
    """
    _check_start(x, settings, generator)
    levels = levels_of(denoiser.schedule, settings) if levels is None else levels
    settled = consensus if settings.consensus else None
    guided = Guided(denoiser, condition, settings)
    predict = partial(_predict, guided, denoiser.predicts, anchor)
    previous: PreviousStep | None = None
    steps = len(levels) - 1

    for step, (here, there) in enumerate(pairwise(levels), start=1):
        agree = settled if here.sigma > settings.consensus_end else None
        own = predict(x, here)
        pair = _agreed(own, x, here, settings, agree)
        match settings.method:
            case "heun":
                corrector = partial(_predict_agreed, predict, settings, agree)
                x = heun(pair, here, there, corrector)
            case "dpm++2m":
                step_before, previous = _settled(own, pair, here, previous, settled)
                x = multistep(pair, here, there, step_before)
            case "euler" | "ddim" | "ancestral":
                x = _one_step(pair, here, there, settings.fresh_noise, share, generator)
        if agree and settings.target == "xt":
            x = agree(x)
        check_finite(x, f"the latents after step {step} of {steps}", here, settings)
        yield SamplerStep(step, steps, there.t, x, pair.x0)


def _settled(
    own: Pair, pair: Pair, here: NoiseLevel, previous: PreviousStep | None, agree: Hook | None
) -> tuple[PreviousStep | None, PreviousStep]:
    """(the step before, as a multistep solver is to see it; this one, to be remembered).

    The solver extrapolates the change of x0 from step to step. With consensus that is the change
    of what views agree on; what they differ in takes Euler's step. Extrapolated, a difference that
    has just been let free, and shrinks with the noise, would overshoot agreement.
    """
    if agree is None:
        return previous, PreviousStep(here, own.x0)
    agreed = PreviousStep(here, agree(own.x0))
    if previous is None:
        return None, agreed
    before = pair.x0 - (agreed.x0 - previous.x0)
    return PreviousStep(previous.level, before), agreed


def _agreed(
    own: Pair, x: Latents, level: NoiseLevel, settings: SamplerSettings, agree: Hook | None
) -> Pair:
    """The solver's input: the views' own predictions at x_t, after consensus if the settings'
    target is one of them.

    Of a pair, the other half is derived anew, so that both still belong to x_t: an eps that a view
    kept would go on removing, step after step, what its x0 has already given up, and lead beyond
    agreement. Where the map changes nothing, the pair stays as it is to the last bit.
    """
    if agree is None or settings.target == "xt":
        return own
    if settings.target == "x0":
        x0 = agree(own.x0)
        return Pair(x0, own.eps - level.a / level.b * (x0 - own.x0))
    eps = agree(own.eps)
    return Pair(clean_of(eps, x, level), eps)


def _predict_agreed(
    predict: Predict, settings: SamplerSettings, agree: Hook | None, x: Latents, level: NoiseLevel
) -> Pair:
    """Predict and agree at another x_t, as Heun's second prediction needs it."""
    return _agreed(predict(x, level), x, level, settings, agree)


def _one_step(
    pair: Pair,
    here: NoiseLevel,
    there: NoiseLevel,
    eta: float,
    share: Hook | None,
    generator: torch.Generator | None,
) -> Latents:
    """A step of ddim, euler or ancestral: part of the noise, by eta, is drawn anew."""
    if eta == 0 or there.b == 0:
        return straight_on(pair, there)
    noise = torch.randn(pair.x0.shape, generator=generator, dtype=pair.x0.dtype)
    return ancestral(pair, here, there, eta, share(noise) if share else noise)


def _predict(
    guided: Callable[[Latents, NoiseLevel], Latents],
    kind: Prediction,
    anchor: Anchor | None,
    x: Latents,
    level: NoiseLevel,
) -> Pair:
    """The guided pair; of an anchored view, its given x0 and the eps that leads there."""
    if anchor is None:
        return as_pair(kind, guided(x, level), x, level)
    free = ~anchor.views
    pair = Pair(anchor.x0.to(x).clone(), noise_of(anchor.x0.to(x), x, level))
    if free.any():
        pair.x0[free], pair.eps[free] = as_pair(kind, guided(x[free], level), x[free], level)
    return pair


def _check_start(x: Latents, settings: SamplerSettings, generator: torch.Generator | None) -> None:
    if settings.fresh_noise > 0 and generator is None:
        name = "eta above 0" if settings.method == "ddim" else settings.method
        raise UsageError(f"{name} draws fresh noise and needs a generator")
    if x.dtype not in (torch.float32, torch.float64):
        raise UsageError(
            f"latents in {x.dtype} lose the small steps: give them in float32 or float64; "
            "a network may compute in any dtype"
        )
