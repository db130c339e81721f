"""Laws of the sampler on denoisers whose answer is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from sampler_runs import last

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Branches, Need, guide
from gsedit.paper.diffusion.sampler import add_noise, levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.settings import EditSettings, Preset, find_preset


def noise(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


SCHEDULE = Schedule.scaled_linear()


@dataclass(frozen=True, eq=False)
class Point:
    """A denoiser that knows x0 of every view: all three branches point at it."""

    x0: torch.Tensor
    name: str = "point"
    schedule: Schedule = SCHEDULE
    predicts: str = "eps"

    def branches(self, x, t, condition, need):
        ab = self.schedule.alpha(t)
        eps = (x - ab**0.5 * self.x0[condition]) / (1 - ab) ** 0.5
        return Branches(*(eps if needed else None for needed in need))


VIEWS = torch.arange(3)


def test_schedule_is_stable_diffusions():
    ab = Schedule.scaled_linear().alphas_cumprod
    assert ab.dtype == torch.float64
    assert len(ab) == 1000
    assert (ab.diff() < 0).all()
    # the values that editing papers quote: SD's first, and sqrt(ab) = 0.19 at t = 801
    torch.testing.assert_close(ab[0].item(), 1 - 0.00085, rtol=1e-12, atol=0)
    assert ab[801].sqrt().item() == pytest.approx(0.19, abs=0.005)


@pytest.mark.parametrize("steps", [1, 7, 20, 50, 1000])
def test_times_at_full_strength_are_leading_spacing(steps):
    times = Schedule.scaled_linear().timesteps(steps)
    offset = 1 if steps < 1000 else 0  # with all 1000 steps there is no room above for one
    expected = [i * (1000 // steps) + offset for i in range(steps)][::-1]
    assert times == expected


def test_times_start_lower_with_less_strength():
    schedule = Schedule.scaled_linear()
    assert schedule.timesteps(20, 0.98)[0] == 19 * 49 + 1
    starts = [schedule.timesteps(20, s)[0] for s in (0.2, 0.5, 0.9, 1.0)]
    assert starts == sorted(starts)
    with pytest.raises(UsageError, match="10 noise levels for 20 steps"):
        schedule.timesteps(20, 0.01)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("steps", 0),
        ("steps", 1001),
        ("guidance_text", -1.0),
        ("guidance_text", float("nan")),
        ("guidance_image", float("inf")),
        ("strength", 0.0),
        ("strength", 1.1),
        ("eta", 1.5),
        ("t_end", -0.1),
    ],
)
def test_a_bad_setting_is_named(setting, value):
    with pytest.raises(UsageError, match=setting):
        SamplerSettings(**{setting: value})


def test_eps_consensus_needs_shared_noise():
    with pytest.raises(UsageError, match="diverges"):
        SamplerSettings(target="eps", noise="independent")
    assert SamplerSettings(target="eps").noise == "shared"


def test_presets():
    paper = find_preset("paper").settings.sampler
    assert find_preset("default") == Preset("What gsedit does.", EditSettings())
    for settings, wanted in ((paper, 10), (SamplerSettings(), 4)):  # the paper's T_end of 50; ours
        schedule = Schedule.scaled_linear()
        levels = levels_of(schedule, settings)[:-1]
        assert sum(level.sigma > settings.consensus_end for level in levels) == wanted
    with pytest.raises(UsageError, match="default, quick, paper"):
        find_preset("fast")


@pytest.mark.parametrize(
    ("guidance_text", "guidance_image", "expected"),
    [
        (7.5, 1.5, Need(True, True, True)),
        (7.5, 1.0, Need(True, True, False)),
        (1.0, 1.5, Need(True, True, True)),
        (1.0, 1.0, Need(True, False, False)),
        (1.5, 1.5, Need(True, False, True)),
        (0.0, 1.5, Need(False, True, True)),
        (0.0, 1.0, Need(False, True, False)),
        (0.0, 0.0, Need(False, False, True)),
    ],
)
def test_branches_are_asked_for_only_where_their_weight_is_not_zero(
    guidance_text, guidance_image, expected
):
    needs = []

    class Spy(Point):
        def branches(self, x, t, condition, need):
            needs.append(need)
            return super().branches(x, t, condition, need)

    model = Spy(noise(1, 2, 1, 3))
    settings = SamplerSettings(steps=2, guidance_text=guidance_text, guidance_image=guidance_image)
    last(sample(model, VIEWS[:1], noise(1, 2, 1, 3, seed=1), settings))
    assert needs == [expected] * 2
    # and the formula says the same, with every branch and without those that are not needed
    text, image, none = noise(3, 1, 2, 2, 2).unbind()
    formula = none + guidance_image * (image - none) + guidance_text * (text - image)
    given = [branch if ask else None for branch, ask in zip((text, image, none), expected)]
    torch.testing.assert_close(guide(*given, guidance_text, guidance_image), formula)
    for missing in range(3):
        if expected[missing]:
            lacking = [None if i == missing else branch for i, branch in enumerate(given)]
            with pytest.raises(ValueError, match="missing"):
                guide(*lacking, guidance_text, guidance_image)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_sampling_ends_at_the_known_answer(dtype):
    model = Point(noise(3, 2, 1, 3, dtype=dtype))
    n = noise(3, 2, 1, 3, seed=1, dtype=dtype)
    state = last(sample(model, VIEWS, n, SamplerSettings()))
    assert state.x.dtype == dtype
    assert (state.step, state.steps, state.t) == (20, 20, 0)
    # float32: eps at the last step divides the rounding of x by sqrt(1 - ab) = 0.04
    torch.testing.assert_close(state.x0, model.x0, rtol=0, atol=200 * torch.finfo(dtype).eps)


def test_noise_that_belongs_to_the_answer_survives():
    """DDIM with the true eps moves along x0 and noise: exact at every step."""
    model = Point(noise(3, 2, 1, 3))
    n = noise(3, 2, 1, 3, seed=1)
    levels = levels_of(model.schedule, SamplerSettings())
    assert levels[0].t == model.schedule.timesteps(20, 0.98)[0]
    x = add_noise(model.x0, n, levels[0])
    for state, level in zip(sample(model, VIEWS, x, SamplerSettings()), levels[1:]):
        assert state.t == level.t
        expected = add_noise(model.x0, n, level)
        torch.testing.assert_close(state.x, expected)


def test_ddim_is_deterministic_and_ddpm_follows_its_generator():
    model = Point(noise(3, 2, 1, 3))
    x = noise(3, 2, 1, 3, seed=1)
    plain = [last(sample(model, VIEWS, x, SamplerSettings())).x for _ in range(2)]
    assert torch.equal(*plain)
    settings = SamplerSettings(eta=1.0)
    drawn = [
        last(sample(model, VIEWS, x, settings, generator=torch.Generator().manual_seed(seed))).x
        for seed in (0, 0, 1)
    ]
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])
    with pytest.raises(UsageError, match="generator"):
        last(sample(model, VIEWS, x, settings))


@pytest.mark.parametrize("target", ["x0", "xt", "eps"])
def test_consensus_acts_only_above_its_noise_level(target):
    calls = []

    def hook(x):
        calls.append(x)
        return x

    model = Point(noise(3, 2, 1, 3))
    settings = SamplerSettings(target=target)
    last(sample(model, VIEWS, noise(3, 2, 1, 3, seed=1), settings, consensus=hook))
    assert len(calls) == 4  # sigma = 9.9, 7.6, 6.0, 4.8 > 4.7
    last(sample(model, VIEWS, calls[0], replace(settings, consensus=False), consensus=hook))
    assert len(calls) == 4
