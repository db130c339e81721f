"""Noise schedules and predictions: levels, times and sigmas, and the pair (x0, eps)."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from mixtures import mixture_problem, noised_draw
from sampler_runs import FLOW, SD, TERMINAL, UNGUIDED, generator, last, pair, rectified_flow, run

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import as_pair
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.schedules import CLEAN, Schedule, karras_sigmas
from gsedit.paper.diffusion.settings import SamplerSettings

SCHEDULES = {
    "SD": SD,
    "terminal": TERMINAL,
    "flow": FLOW,
    "shifted flow": rectified_flow(shift=3.0),
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
    assert rectified_flow(shift=3.0).level(499).b == pytest.approx(0.75)
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


@pytest.mark.parametrize("schedule", [SD, FLOW], ids=["unit power", "straight"])
@pytest.mark.parametrize("kind", ["eps", "x0", "v", "flow"])
def test_every_prediction_is_the_same_pair(schedule, kind):
    level, found = schedule.level(321), pair()
    x = level.a * found.x0 + level.b * found.eps
    predicted = {
        "eps": found.eps,
        "x0": found.x0,
        "v": level.a * found.eps - level.b * found.x0,
        "flow": found.eps - found.x0,
    }[kind]
    for ours, expected in zip(as_pair(kind, predicted, x, level), found):
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
    for schedule, kind in ((SD, "eps"), (FLOW, "flow"), (SD, "v")):
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


def test_a_rectified_flow_reads_a_thousand_times_its_share_of_noise():
    level = Schedule.rectified_flow().level_at(1.0)
    assert (level.t, level.a, level.b) == pytest.approx((500, 0.5, 0.5))
