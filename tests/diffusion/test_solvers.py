"""Each solver against the exact path of the ODE, and against the formulas of its paper."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from closeness import slope
from mixtures import MixtureProblem, exact_solution, mixture_problem, noised_draw
from sampler_runs import FLOW, SD, UNGUIDED, generator, last, pair, run

from gsedit.errors import UsageError
from gsedit.paper.diffusion.sampler import ancestral, levels_of, sample
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule, karras_sigmas
from gsedit.paper.diffusion.settings import SamplerSettings


def ladder(schedule: Schedule, steps: int) -> list[NoiseLevel]:
    """From the top of SD's schedule to its cleanest level: where the reference stops, too."""
    sigmas = karras_sigmas(SD.level(999).sigma, SD.level(0).sigma, steps + 1)
    return [schedule.level_at(sigma) for sigma in sigmas]


@pytest.fixture(scope="module")
def exact():
    """(problem, where it starts, the ODE's answer)."""
    model = mixture_problem(0.5)
    first = ladder(SD, 1)[0]
    x = noised_draw(model, first)
    return model, x, exact_solution(model, x, first, SD.level(0).sigma)


def error(exact, solver: str, steps: int, model: MixtureProblem | None = None) -> float:
    known, x, answer = exact
    model = model or known
    levels = ladder(model.schedule, steps)
    first = SD.level(999)
    x = x * (levels[0].a / first.a)  # the same q at the scale of this schedule
    settings = replace(UNGUIDED, solver=solver)
    state = last(sample(model, None, x, settings, levels=levels))
    return float((state.x / levels[-1].a - answer).square().mean().sqrt())


@pytest.mark.parametrize(
    ("solver", "order", "within"),
    [("ddim", 1, 0.2), ("euler", 1, 0.2), ("heun", 2, 0.3), ("dpm++2m", 2, 0.3)],
)
@pytest.mark.parametrize("kind", ["eps on SD", "flow on a straight path"])
def test_error_falls_with_the_solvers_order(exact, solver, order, within, kind):
    model = exact[0]
    if kind.startswith("flow"):
        model = replace(model, schedule=FLOW, predicts="flow")
    points = [(float(n), error(exact, solver, n, model)) for n in (12, 24, 48, 96, 192)]
    assert slope(points) == pytest.approx(-order, abs=within)
    # the constant, too, is small: 192 steps reach what the order promises from 12
    assert points[-1][1] < points[0][1] * 16**-order * 2


def test_the_reference_of_one_gaussian_is_its_closed_form():
    """q - mu shrinks as sqrt(w^2 + sigma^2): the ODE moves every quantile to itself."""
    width = 0.3
    model = mixture_problem(width)
    certain = torch.zeros(8, 1, dtype=torch.float64)
    one = model.text_image._replace(offsets=model.text_image.offsets[:1], log_weights=certain)
    first = SD.level(999)
    x = noised_draw(model, first)
    q = exact_solution(replace(model, text_image=one), x, first, 0.05)
    shrunk = math.sqrt((width**2 + 0.05**2) / (width**2 + first.sigma**2))
    torch.testing.assert_close(q, one.offsets[0] + (x / first.a - one.offsets[0]) * shrunk)


HERE, THERE = SD.level(700), SD.level(500)


@pytest.mark.parametrize("eta", [0.3, 1.0])
def test_fresh_noise_is_that_of_ddim(eta):
    """Eqs. 12 and 16 of Song et al. 2021."""
    found, noise = pair(), pair(1).eps
    ab, ab_next = HERE.a**2, THERE.a**2
    deviation = eta * math.sqrt((1 - ab_next) / (1 - ab) * (1 - ab / ab_next))
    expected = THERE.a * found.x0 + (1 - ab_next - deviation**2) ** 0.5 * found.eps
    torch.testing.assert_close(
        ancestral(found, HERE, THERE, eta, noise), expected + deviation * noise
    )


def test_ancestral_is_ddim_at_eta_one_and_k_diffusions_step():
    found, noise = pair(), pair(1).eps
    up = (THERE.sigma**2 * (HERE.sigma**2 - THERE.sigma**2) / HERE.sigma**2) ** 0.5
    down = (THERE.sigma**2 - up**2) ** 0.5
    q = found.x0 + HERE.sigma * found.eps
    expected = q + (down - HERE.sigma) * found.eps + up * noise
    torch.testing.assert_close(ancestral(found, HERE, THERE, 1.0, noise) / THERE.a, expected)
    ends_clean = replace(UNGUIDED, spacing="linspace", steps=5)
    model = mixture_problem(0.5)
    ddpm = run(model, replace(ends_clean, solver="ddim", eta=1.0))
    assert torch.equal(run(model, replace(ends_clean, solver="ancestral")), ddpm)
    assert not torch.equal(run(model, replace(ends_clean, solver="euler")), ddpm)


def test_second_order_is_exact_where_their_papers_say_so():
    """2M is exact for an x0 that is linear in log(a/b); Heun for an eps that is linear in sigma."""
    levels = [SD.level(t) for t in (800, 600, 450)]

    class Linear(MixtureProblem):
        def branches(self, x, t, condition, need):
            level = self.schedule.level(t)
            if self.predicts == "x0":
                return type(super().branches(x, t, condition, need))(
                    torch.full_like(x, math.log(level.sigma)), None, None
                )
            return type(super().branches(x, t, condition, need))(
                torch.full_like(x, level.sigma), None, None
            )

    fields = vars(mixture_problem(0.5, shape=(1, 1, 1, 1)))
    q = torch.full((1, 1, 1, 1), 2.0, dtype=torch.float64)
    heun = replace(UNGUIDED, solver="heun")
    states = [*sample(Linear(**fields), None, q * levels[0].a, heun, levels=levels)]
    expected = 2 + (levels[2].sigma ** 2 - levels[0].sigma ** 2) / 2
    assert states[-1].x.item() / levels[2].a == pytest.approx(expected, rel=1e-12)
    # the second step of 2M, from where its first arrived: D in the exponential integrator is the
    # mean of x0 over the step up to h^2, and for a linear x0 that is its extrapolated midpoint
    multistep = replace(UNGUIDED, solver="dpm++2m")
    model = Linear(**fields | {"predicts": "x0"})
    states = [*sample(model, None, q * levels[0].a, multistep, levels=levels)]
    (_, b1), (a2, b2) = ((level.a, level.b) for level in levels[1:])
    logs = [math.log(level.sigma) for level in levels]
    middle = logs[1] + (logs[2] - logs[1]) / 2
    expected = b2 / b1 * states[0].x.item() - a2 * math.expm1(logs[2] - logs[1]) * middle
    assert states[1].x.item() == pytest.approx(expected, rel=1e-12)


def test_ancestral_samples_have_the_variance_that_their_noise_adds_up_to():
    """For one Gaussian a step is linear, so the variance follows a recursion; it ends near w^2."""
    shape, width = (2, 1, 40, 40), 0.4
    model = mixture_problem(width, shape=shape)
    one = model.text_image._replace(
        offsets=torch.zeros(1, *shape, dtype=torch.float64),
        log_weights=torch.zeros(2, 1, dtype=torch.float64),
    )
    settings = replace(UNGUIDED, solver="ancestral", steps=100)
    levels = levels_of(SD, settings)
    variance = width**2 + levels[0].sigma ** 2
    for here, there in pairwise(levels):
        share = width**2 / (width**2 + here.sigma**2)
        up = (there.sigma**2 * (1 - there.sigma**2 / here.sigma**2)) ** 0.5
        down = (there.sigma**2 - up**2) ** 0.5
        variance *= (share + down * (1 - share) / here.sigma) ** 2
        variance += up**2
    assert variance**0.5 == pytest.approx(width, rel=0.1)  # first-order: 100 steps
    x = noised_draw(model, levels[0])
    x -= levels[0].a * model.text_image.offsets[0]  # a draw of the one Gaussian about 0
    states = sample(replace(model, text_image=one), None, x, settings, generator=generator())
    # the deviation of a standard deviation of 3200 numbers is 1/sqrt(6400) = 1.25 %: three of it
    assert last(states).x.std().item() == pytest.approx(variance**0.5, rel=0.0375)


@pytest.mark.parametrize("solver", ["euler", "heun", "dpm++2m"])
def test_eta_is_for_ddim(solver):
    with pytest.raises(UsageError, match=f"for the solver ddim, {re.escape(solver)}"):
        SamplerSettings(solver=solver, eta=0.5)


def test_ancestral_needs_a_generator_and_one_step_draws_nothing():
    model = mixture_problem(0.3)
    settings = replace(UNGUIDED, solver="ancestral", steps=1)
    x = noised_draw(model, levels_of(SD, settings)[0])
    with pytest.raises(UsageError, match="ancestral draws fresh noise"):
        last(sample(model, None, x, settings))
    ended = last(sample(model, None, x, settings, generator=generator())).x
    assert torch.equal(ended, run(model, replace(settings, solver="euler")))
