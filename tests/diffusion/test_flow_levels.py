"""The levels of flow models against diffusers' own scheduler."""

import itertools

import numpy as np
import pytest
import torch
from closeness import EPS32, assert_near
from diffusers.pipelines.flux.pipeline_flux import calculate_shift
from diffusers.pipelines.flux2.pipeline_flux2_klein import compute_empirical_mu
from diffusers.schedulers.scheduling_flow_match_euler_discrete import (
    FlowMatchEulerDiscreteScheduler,
)

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.flow import OTHER_LINES, FlowScheduler, check_spacing, empirical_mu
from gsedit.paper.diffusion.schedules import CLEAN
from gsedit.paper.diffusion.settings import SamplerSettings

CONFIGS = {
    "static": {"shift": 3.0},
    "exponential": {"use_dynamic_shifting": True},
    "linear": {"use_dynamic_shifting": True, "time_shift_type": "linear"},
    "terminal": {"use_dynamic_shifting": True, "shift_terminal": 0.02, "max_shift": 0.9},
}


@pytest.mark.parametrize(("name", "steps"), itertools.product(CONFIGS, (1, 4, 28)))
def test_levels_equal_diffusers(name, steps):
    if steps == 1 and name == "terminal":
        pytest.skip("diffusers divides by zero")
    theirs = FlowMatchEulerDiscreteScheduler(**CONFIGS[name])
    mu = calculate_shift(1000, 256, 4096, theirs.config["base_shift"], theirs.config["max_shift"])
    sigmas = np.linspace(1.0, 1 / steps, steps).tolist()
    theirs.set_timesteps(steps, sigmas=sigmas, mu=mu)
    ours = FlowScheduler.read(theirs.config, "scheduler_config.json")
    levels = ours.levels(steps, mu=ours.mu(1000))
    torch.testing.assert_close(torch.tensor([level.b for level in levels]), theirs.sigmas)
    times = torch.tensor([level.t for level in levels[:-1]])
    assert_near(times, theirs.timesteps, 10 * EPS32)
    assert all(level.a == 1 - level.b for level in levels)
    assert levels[-1] == CLEAN


@pytest.mark.parametrize("name", CONFIGS)
def test_less_strength_starts_below_the_noise_and_still_falls(name):
    flow = FlowScheduler.read(CONFIGS[name], "")
    levels = flow.levels(6, 0.5, mu=1.2)
    noise = [level.b for level in levels]
    assert noise == sorted(noise, reverse=True)
    assert 0.5 < noise[0] < 1
    assert noise[5] == pytest.approx(0.02) if name == "terminal" else noise[5] < noise[0]


@pytest.mark.parametrize(("tokens", "steps"), [(256, 4), (1024, 50), (4300, 4), (5000, 4)])
def test_the_shift_of_flux_2_equals_diffusers(tokens, steps):
    expected = compute_empirical_mu(tokens, steps)
    assert empirical_mu(tokens, steps) == pytest.approx(expected, rel=1e-9)


def test_one_level_of_pure_noise_is_not_stretched():
    flow = FlowScheduler.read(CONFIGS["terminal"], "")
    first, end = flow.levels(1, mu=0.5)
    assert (first.b, end.b) == (1, 0)


@pytest.mark.parametrize("option", OTHER_LINES)
def test_another_schedule_is_refused_by_name(option):
    with pytest.raises(InputError, match=f"here.json.*{option}"):
        FlowScheduler.read({option: True}, "here.json")


@pytest.mark.parametrize(
    ("config", "named"),
    [
        ({"_class_name": "UniPCMultistepScheduler"}, "UniPCMultistepScheduler"),
        ({"time_shift_type": "cubic"}, "cubic"),
        ({"shift": "three"}, "shift is 'three'"),
        ({"shift": 0}, "shift is 0"),
        ({"shift_terminal": 1.0}, "shift_terminal"),
    ],
)
def test_a_bad_value_is_refused_by_name(config, named):
    with pytest.raises(InputError, match=f"here.json.*{named}"):
        FlowScheduler.read(config, "here.json")


def test_a_spacing_of_another_model_is_refused():
    check_spacing(SamplerSettings())
    with pytest.raises(UsageError, match="karras"):
        check_spacing(SamplerSettings(spacing="karras"))
