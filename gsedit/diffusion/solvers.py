"""One step of a sampler, from a noise level to the next, given the network's prediction.

The probability-flow ODE is dq/dsigma = eps in q = x / a (Karras et al. 2022, eq. 4). All steps are
written in a, b and the pair (x0, eps), so that a may be 0 at the start (sigma infinite) and b at
the end. Errors fall with the number of steps as 1/N (ddim, euler) or 1/N^2 (heun, dpm++2m);
ancestral draws noise and has no path to be near to.

Three functions are five solvers. DDIM without noise *is* Euler's method in sigma, and with eta 1 it
*is* the ancestral sampler; as in diffusers `ddim` may end at training step 0 where the others end
without noise.

Limits (`gsedit bench sampler`: widths of the data 1 to 1e-4, guidance 1 to 30, 1 to 1000 steps,
terminal SNR 0, predictions in bfloat16 and float16). On Stable Diffusion's own levels all solvers
are finite everywhere and end in the data with 20 steps and more. One step at guidance 30 overshoots
18-fold whatever the solver, and two of Heun's from guidance 7.5 on. Where levels go down to narrow
data's width, DDIM is safe from 10 evaluations on at any guidance, dpm++2m too (at 5 it leaves the
data from guidance 7.5 on), and Heun with guidance needs 40: its second prediction is taken where
Euler overshot. Beyond, dpm++2m errs least per evaluation: from 10 at width 1, from 80 with guidance
at width 1e-4; below that DDIM does. Noise predictions cannot start at a terminal SNR of 0.
"""

from __future__ import annotations

from collections.abc import Callable
from math import log
from typing import NamedTuple

from gsedit.diffusion.predictions import Latents, Pair
from gsedit.diffusion.schedules import NoiseLevel

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
    """Where the step before began, and what it predicted there."""

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
