"""The sampler at its limits: terminal SNR 0, stiff data, strong guidance, low precision."""

from dataclasses import replace

import pytest
import torch
from mixtures import MixtureProblem, mixture_problem
from sampler_runs import FLOW, SD, SOLVERS, TERMINAL, UNGUIDED, run

from gsedit.errors import UsageError
from gsedit.paper.diffusion.sampler import levels_of
from gsedit.paper.diffusion.settings import SamplerSettings


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

    with pytest.raises(UsageError, match=r"mixture's prediction \(in torch.float16\) at t = 999"):
        run(Overflowing(**vars(mixture_problem(0.5))), replace(UNGUIDED, steps=5))


@pytest.mark.parametrize("shape", [(1, 4, 1, 1), (2, 4, 3, 7), (64, 1, 2, 1)])
@pytest.mark.parametrize("solver", SOLVERS)
def test_any_shape_of_latents(shape, solver):
    model = mixture_problem(0.3, shape=shape)
    found = run(model, SamplerSettings(steps=3, solver=solver), state=torch.float32)
    assert found.shape == shape
    assert found.isfinite().all()
