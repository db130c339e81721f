"""Each solver against the exact path of the ODE; schedules, predictions, and extreme settings."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from gsedit.bench.curves import slope
from gsedit.bench.sampler.mixtures import (
    MixtureProblem,
    exact_solution,
    mixture_problem,
    noised_draw,
)
from gsedit.diffusion import (
    CLEAN,
    Need,
    NoiseLevel,
    Pair,
    SamplerSettings,
    Schedule,
    as_pair,
    karras_sigmas,
    levels_of,
    sample,
)
from gsedit.diffusion.solvers import ancestral, straight_on
from gsedit.errors import UsageError

SD = Schedule.scaled_linear()
TERMINAL = SD.zero_terminal_snr()
FLOW = Schedule.rectified_flow()
SOLVERS = ("ddim", "euler", "heun", "dpm++2m", "ancestral")
UNGUIDED = SamplerSettings(
    guidance_text=1.0, guidance_image=1.0, strength=1.0, spacing="karras", consensus=False
)
EPS64 = torch.finfo(torch.float64).eps


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


# --- the proof: errors fall with their order ---


def ladder(schedule: Schedule, steps: int) -> list[NoiseLevel]:
    """From the top of SD's schedule to its cleanest level: where the reference stops, too."""
    sigmas = karras_sigmas(SD.level(999).sigma, SD.level(0).sigma, steps + 1)
    return [schedule.level_at(sigma) for sigma in sigmas]


@pytest.fixture(scope="module")
def exact():
    """(problem, where it starts, the ODE's answer): 10^4 steps of Runge and Kutta in float64."""
    model = mixture_problem(0.5)
    first = ladder(SD, 1)[0]
    x = noised_draw(model, first)
    return model, x, exact_solution(model, x, first, UNGUIDED, SD.level(0).sigma)


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


def test_the_reference_does_not_depend_on_its_steps(exact):
    model, x, answer = exact
    coarse = exact_solution(model, x, SD.level(999), UNGUIDED, SD.level(0).sigma, steps=500)
    # a fourth-order method at a twentieth of the steps has 20^4 = 160,000 times the error
    torch.testing.assert_close(coarse, answer, rtol=0, atol=1e-8)


def test_the_reference_of_one_gaussian_is_its_closed_form():
    """q - mu shrinks as sqrt(w^2 + sigma^2): the ODE moves every quantile to itself."""
    width = 0.3
    model = mixture_problem(width)
    certain = torch.zeros(8, 1, dtype=torch.float64)
    one = model.text_image._replace(offsets=model.text_image.offsets[:1], log_weights=certain)
    first = SD.level(999)
    x = noised_draw(model, first)
    q = exact_solution(replace(model, text_image=one), x, first, UNGUIDED, 0.05, steps=1000)
    shrunk = math.sqrt((width**2 + 0.05**2) / (width**2 + first.sigma**2))
    torch.testing.assert_close(q, one.offsets[0] + (x / first.a - one.offsets[0]) * shrunk)


# --- solvers against the formulas of their papers ---

HERE, THERE = SD.level(700), SD.level(500)


def pair(seed: int = 0) -> Pair:
    x0, eps = torch.randn(2, 1, 2, 3, 3, generator=generator(seed), dtype=torch.float64)
    return Pair(x0, eps)


def test_ddim_without_noise_is_eulers_step_in_sigma():
    found = pair()
    q = (HERE.a * found.x0 + HERE.b * found.eps) / HERE.a
    moved = q + (THERE.sigma - HERE.sigma) * found.eps
    torch.testing.assert_close(straight_on(found, THERE) / THERE.a, moved)


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

    base = mixture_problem(0.5, shape=(1, 1, 1, 1))
    fields = {name: getattr(base, name) for name in ("text_image", "image", "none")}
    q = torch.full((1, 1, 1, 1), 2.0, dtype=torch.float64)
    heun = replace(UNGUIDED, solver="heun")
    states = [*sample(Linear(**fields), None, q * levels[0].a, heun, levels=levels)]
    expected = 2 + (levels[2].sigma ** 2 - levels[0].sigma ** 2) / 2
    assert states[-1].x.item() / levels[2].a == pytest.approx(expected, rel=1e-12)
    # the second step of 2M, from where its first arrived: D in the exponential integrator is the
    # mean of x0 over the step up to h^2, and for a linear x0 that is its extrapolated midpoint
    multistep = replace(UNGUIDED, solver="dpm++2m")
    model = Linear(**fields, predicts="x0")
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


# --- predictions ---


@pytest.mark.parametrize("schedule", [SD, FLOW], ids=["unit power", "straight"])
@pytest.mark.parametrize("kind", ["eps", "x0", "v", "flow"])
def test_every_prediction_is_the_same_pair(schedule, kind):
    level, found = schedule.level(321), pair()
    x = level.a * found.x0 + level.b * found.eps
    told = {
        "eps": found.eps,
        "x0": found.x0,
        "v": level.a * found.eps - level.b * found.x0,
        "flow": found.eps - found.x0,
    }[kind]
    for ours, expected in zip(as_pair(kind, told, x, level), found):
        torch.testing.assert_close(ours, expected)


@pytest.mark.parametrize("solver", ["ddim", "heun", "dpm++2m"])
def test_what_is_predicted_and_guided_does_not_matter(solver):
    """The weights of guidance sum to 1, so that any of the four may be guided."""
    settings = SamplerSettings(steps=12, solver=solver, strength=1.0)
    runs = [
        run(mixture_problem(0.3, predicts=kind), settings) for kind in ("eps", "x0", "v", "flow")
    ]
    for other in runs[1:]:
        torch.testing.assert_close(other, runs[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("solver", ["ddim", "heun", "dpm++2m", "ancestral"])
def test_a_straight_path_is_the_same_path(solver):
    """The ODE in q and sigma knows no schedule: equal sigmas, equal answers."""
    sigmas = karras_sigmas(10.0, 0.05, 12)
    settings, results = replace(UNGUIDED, solver=solver), []
    for schedule, kind in ((SD, "eps"), (FLOW, "flow"), (Schedule.cosine(), "v")):
        model = mixture_problem(0.3, schedule=schedule, predicts=kind)
        levels = [*(schedule.level_at(sigma) for sigma in sigmas), CLEAN]
        q = noised_draw(mixture_problem(0.3), SD.level_at(10.0)) / SD.level_at(10.0).a
        states = sample(
            model, None, q * levels[0].a, settings, levels=levels, generator=generator()
        )
        results.append(last(states).x)
    for other in results[1:]:
        # the level is found again from its training step, with the rounding of 1 - ab
        torch.testing.assert_close(other, results[0], rtol=1e-8, atol=1e-8)


# --- schedules ---

SCHEDULES = {
    "SD": SD,
    "cosine": Schedule.cosine(),
    "terminal": TERMINAL,
    "flow": FLOW,
    "shifted flow": Schedule.rectified_flow(shift=3.0),
}


@pytest.mark.parametrize("name", SCHEDULES)
def test_levels_fall_and_times_and_sigmas_are_inverse(name):
    schedule = SCHEDULES[name]
    top = len(schedule.alphas_cumprod) - 1
    levels = [schedule.level(t) for t in (0.5, 1, 2.25, 77, 500.75, top - 1)]
    assert all(low.sigma < high.sigma for low, high in pairwise(levels))
    for level in levels:
        unit = level.a + level.b if schedule.straight else level.a**2 + level.b**2
        assert unit == pytest.approx(1, rel=1e-12)
        found = schedule.level_at(level.sigma)
        assert found == pytest.approx(level, rel=1e-6)


def test_the_schedules_are_those_of_their_papers():
    assert (TERMINAL.alphas_cumprod[-1], TERMINAL.alphas_cumprod[0]) == (0, SD.alphas_cumprod[0])
    shape = SD.alphas_cumprod.sqrt()  # a linear map of it: Lin et al. 2024
    torch.testing.assert_close(
        TERMINAL.alphas_cumprod.sqrt()[1:-1].diff() / shape[1:-1].diff(),
        torch.full((997,), (shape[0] / (shape[0] - shape[-1])).item(), dtype=torch.float64),
    )
    half = Schedule.cosine().alphas_cumprod[499]  # cos^2 of (1/2 + s)/(1 + s) of a right angle
    start_of = math.cos(0.008 / 1.008 * math.pi / 2) ** 2
    expected = math.cos(0.508 / 1.008 * math.pi / 2) ** 2 / start_of
    assert half.item() == pytest.approx(expected, rel=1e-9)
    assert Schedule.rectified_flow(shift=3.0).level(499).b == pytest.approx(0.75)
    assert [FLOW.level(t).b for t in (0, 249, 999)] == pytest.approx([1e-3, 0.25, 1])
    sigmas = karras_sigmas(80.0, 0.002, 18)  # Karras et al. 2022, eq. 5
    assert (sigmas[0], sigmas[-1]) == pytest.approx((80, 0.002))
    assert sigmas[5] == pytest.approx((80 ** (1 / 7) * 12 / 17 + 0.002 ** (1 / 7) * 5 / 17) ** 7)


@pytest.mark.parametrize("name", SCHEDULES)
@pytest.mark.parametrize("spacing", ["leading", "linspace", "trailing", "karras"])
@pytest.mark.parametrize("strength", [1.0, 0.98, 0.4])
def test_a_ladder_has_one_level_more_than_steps_and_falls(name, spacing, strength):
    schedule = SCHEDULES[name]
    top = schedule.t_max(strength) - 1
    for steps in (1, 7, 20, 400):
        if spacing == "karras" and math.isinf(schedule.level(top).sigma):
            with pytest.raises(UsageError, match=r"karras.*trailing or linspace"):
                schedule.levels(steps, strength, spacing)
            continue
        levels = schedule.levels(steps, strength, spacing)
        assert len(levels) == steps + 1
        assert levels[-1] == CLEAN
        assert all(high.sigma > low.sigma for high, low in pairwise(levels[: steps + 1]))
        if spacing != "leading":
            assert levels[0].t == pytest.approx(top)


def test_stable_diffusions_ddim_ends_at_its_first_level():
    settings = SamplerSettings(steps=20)
    assert levels_of(SD, settings)[-1] == SD.level(0)
    assert levels_of(SD, replace(settings, solver="euler"))[-1] == CLEAN
    assert levels_of(SD, replace(settings, spacing="linspace"))[-1] == CLEAN


# --- extremes ---


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", ["x0", "v", "flow"])
@pytest.mark.parametrize("spacing", ["trailing", "linspace"])
def test_a_terminal_snr_of_zero(solver, kind, spacing):
    settings = replace(UNGUIDED, solver=solver, steps=20, spacing=spacing)
    for schedule in (TERMINAL, FLOW):
        model = mixture_problem(0.3, schedule=schedule, predicts=kind)
        first = levels_of(schedule, settings)[0]
        assert first.a == 0
        found = run(model, settings)
        # all samples end within a few widths of a component, as far as 20 steps go
        distance = (found - model.text_image.offsets).flatten(2).norm(dim=-1).amin(0)
        assert distance.max() < 2.0


def test_noise_predictions_cannot_start_at_a_terminal_snr_of_zero():
    settings = replace(UNGUIDED, steps=20, spacing="trailing")
    with pytest.raises(UsageError, match=r"terminal SNR is 0.*strength below 1"):
        run(mixture_problem(0.3, schedule=TERMINAL), settings)
    assert (
        run(mixture_problem(0.3, schedule=TERMINAL), replace(settings, strength=0.9))
        .isfinite()
        .all()
    )


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("width", [1.0, 1e-2, 1e-4])
@pytest.mark.parametrize("guidance", [1.0, 7.5, 30.0])
def test_stiff_data_and_strong_guidance_stay_finite(solver, width, guidance):
    model = mixture_problem(width)
    for steps in (1, 2, 20):
        settings = SamplerSettings(
            steps=steps, guidance_text=guidance, solver=solver, strength=1.0, spacing="karras"
        )
        assert run(model, settings, state=torch.float32).isfinite().all()


@pytest.mark.parametrize("solver", ["ddim", "heun", "dpm++2m"])
def test_a_thousand_steps(solver):
    settings = replace(UNGUIDED, steps=1000, solver=solver, spacing="leading")
    levels = levels_of(SD, settings)
    assert (levels[0].t, len(levels)) == (999, 1001)
    found = run(mixture_problem(0.3), settings)
    assert found.isfinite().all()


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
@pytest.mark.parametrize("solver", ["ddim", "heun", "dpm++2m"])
def test_networks_of_low_precision_keep_a_state_of_full_precision(dtype, solver):
    settings = replace(UNGUIDED, solver=solver, steps=20)
    exact = run(mixture_problem(0.5), settings)
    rough = run(mixture_problem(0.5, dtype=dtype), settings, state=torch.float32)
    assert rough.dtype == torch.float32
    # an error of half a unit in the last place at sigma 14.6, not amplified by later steps
    assert (rough - exact).square().mean().sqrt() < 14.6 * torch.finfo(dtype).eps


def test_a_half_precision_state_is_refused():
    with pytest.raises(UsageError, match="float32 or float64"):
        run(mixture_problem(0.5), UNGUIDED, state=torch.bfloat16)


def test_an_overflowing_network_is_named():
    class Overflowing(MixtureProblem):
        def branches(self, x, t, condition, need):
            found = super().branches(x, t, condition, need)
            return type(found)(*(None if b is None else (b * 1e9).half() for b in found))

    base = mixture_problem(0.5)
    fields = {name: getattr(base, name) for name in ("text_image", "image", "none")}
    with pytest.raises(UsageError, match=r"mixture's answer \(in torch.float16\) at t = 999"):
        run(Overflowing(**fields), replace(UNGUIDED, steps=5))


@pytest.mark.parametrize("shape", [(1, 4, 1, 1), (2, 4, 3, 7), (64, 1, 2, 1)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_any_shape_of_latents(shape, solver):
    model = mixture_problem(0.3, shape=shape)
    found = run(model, SamplerSettings(steps=3, solver=solver), state=torch.float32)
    assert found.shape == shape
    assert found.isfinite().all()


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


def test_evaluations_of_each_solver():
    """One a step; heun two, but for the last step, which ends at no noise."""
    for solver in SOLVERS:
        asked = []

        class Counting(MixtureProblem):
            def branches(self, x, t, condition, need, asked=asked):
                asked.append(need)
                return super().branches(x, t, condition, need)

        base = mixture_problem(0.5)
        fields = {name: getattr(base, name) for name in ("text_image", "image", "none")}
        run(Counting(**fields), replace(UNGUIDED, solver=solver, steps=6))
        assert asked == [Need(True, False, False)] * (11 if solver == "heun" else 6)
