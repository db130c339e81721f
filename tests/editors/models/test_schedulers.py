"""Scheduler classes: each gives its own noise, step for step as in diffusers, or is refused."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import diffusers
import model_laws
import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_models import PROMPT, SD

from gsedit.diffusion.sampler import sample
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import for_settings, levels_for
from gsedit.errors import InputError, UsageError
from gsedit.models.loading import load_model
from gsedit.models.noise import noise_of

pytestmark = pytest.mark.usefixtures("offline")
VIEWS, CELLS = 2, 16
FLOW = {"use_flow_sigmas": True, "prediction_type": "flow_prediction"}
EDM = {"sigma_min": 0.002, "sigma_max": 120.0, "sigma_data": 1.0, "prediction_type": "v_prediction"}


def scheduled(source: Path, folder: Path, scheduler, **index: object) -> Path:
    """A copy of a model with another scheduler, and changes of its model_index.json."""
    shutil.copytree(source, folder)
    scheduler.save_pretrained(folder / "scheduler")
    path = folder / "model_index.json"
    named = {"scheduler": ["diffusers", type(scheduler).__name__]}
    path.write_text(json.dumps(json.loads(path.read_text()) | named | index))
    return folder


def drawn(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures, and noise to start from."""
    g = torch.Generator().manual_seed(seed)
    side = 2 * CELLS
    return torch.rand(VIEWS, side, side, 3, generator=g), torch.randn(
        VIEWS, 4, CELLS, CELLS, generator=g
    )


def ours(folder: Path, settings: SamplerSettings) -> list[torch.Tensor]:
    """Latents after every step, as x_t / a where a is not 0: in units of a clean latent."""
    model, settings = for_settings(load_model(folder, micro_batch=VIEWS), settings)
    pictures, start = drawn(3)
    levels = levels_for(model, settings, (CELLS, CELLS))
    condition = model.condition(pictures, PROMPT, torch.Generator())
    g = torch.Generator().manual_seed(7)
    steps = sample(model, condition, start, settings, levels=levels, generator=g)
    return [step.x / level.a for step, level in zip(steps, levels[1:])]


def theirs(pipe, settings: SamplerSettings, **options: object) -> list[torch.Tensor]:
    """Latents of diffusers' pipeline after every step."""
    pictures, start = drawn(3)
    seen = []
    pipe.set_progress_bar_config(disable=True)
    pipe(
        [PROMPT] * VIEWS,
        image=pictures.movedim(-1, 1),
        num_inference_steps=settings.steps,
        guidance_scale=settings.guidance_text,
        image_guidance_scale=settings.guidance_image,
        latents=start,
        generator=torch.Generator().manual_seed(7),
        output_type="latent",
        callback=lambda step, t, x: seen.append(x.clone()),
        callback_steps=1,
        **options,
    )
    return seen


def settings_of(steps: int, **changes: object) -> SamplerSettings:
    return SamplerSettings(
        steps=steps, guidance_text=5.0, guidance_image=1.5, strength=1.0, consensus=False, **changes
    )


@pytest.mark.parametrize("spacing", ["karras", "exponential"])
def test_cosxl_edit_equals_diffusers(xl_pipeline, xl_folder, tmp_path, spacing):
    scheduler = diffusers.EDMEulerScheduler(**EDM, sigma_schedule=spacing)
    folder = scheduled(xl_folder, tmp_path / "cosxl", scheduler, is_cosxl_edit=True)
    pipe = diffusers.StableDiffusionXLInstructPix2PixPipeline(
        **{**xl_pipeline.components, "scheduler": scheduler},
        is_cosxl_edit=True,
        add_watermarker=False,
    )
    settings = settings_of(4)
    expected = theirs(pipe, settings, height=2 * CELLS, width=2 * CELLS)
    found = ours(folder, settings)
    assert len(found) == len(expected) == 4
    for x, y in zip(found, expected):
        assert_near(x, y, NETWORK)


@pytest.mark.parametrize("steps", [1, 4])
def test_consistency_models_equal_diffusers(pipeline, folder, tmp_path, steps):
    scheduler = diffusers.LCMScheduler(**SD)
    copy = scheduled(folder, tmp_path / "lcm", scheduler)
    pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
        **{**pipeline.components, "scheduler": scheduler}, requires_safety_checker=False
    )
    settings = settings_of(steps)
    expected, found = theirs(pipe, settings), ours(copy, settings)
    declared = load_model(copy).capabilities.defaults
    assert (declared.solver, declared.steps) == ("lcm", 4)
    assert len(found) == len(expected) == steps
    level = [1.0] if steps == 1 else None
    times = [int(t) for t in scheduler.timesteps]
    scales = level or [float(scheduler.alphas_cumprod[t] ** 0.5) for t in times[1:]] + [1.0]
    for x, y, a in zip(found, expected, scales):
        assert_near(x, y / a, NETWORK)


def test_a_consistency_model_has_only_so_many_levels(folder, tmp_path):
    copy = scheduled(folder, tmp_path / "lcm", diffusers.LCMScheduler(**SD))
    model = load_model(copy)
    with pytest.raises(UsageError, match="leaves 49: ask for at most 49 steps, not 50"):
        levels_for(model, SamplerSettings(steps=50), (CELLS, CELLS))


@pytest.mark.parametrize("alpha", [True, False])
def test_the_last_level_is_the_scheduler_s(pipeline, folder, tmp_path, alpha):
    scheduler = diffusers.DDIMScheduler(**{**SD, "set_alpha_to_one": alpha})
    copy = scheduled(folder, tmp_path / "last", scheduler)
    pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
        **{**pipeline.components, "scheduler": scheduler}, requires_safety_checker=False
    )
    settings = settings_of(2)
    found = ours(copy, settings)[-1]
    a = float(scheduler.final_alpha_cumprod**0.5)
    assert_near(found * a, theirs(pipe, settings)[-1], NETWORK)


def test_trailing_steps_are_the_scheduler_s(folder, tmp_path):
    scheduler = diffusers.DDIMScheduler(**SD, timestep_spacing="trailing")
    model = load_model(scheduled(folder, tmp_path / "trailing", scheduler))
    scheduler.set_timesteps(7)
    model, settings = for_settings(model, settings_of(7))
    levels = levels_for(model, settings, (CELLS, CELLS))
    assert [level.t for level in levels[:-1]] == scheduler.timesteps.tolist()


def test_karras_sigmas_are_the_scheduler_s(folder, tmp_path):
    scheduler = diffusers.EulerDiscreteScheduler(
        beta_start=SD["beta_start"],
        beta_end=SD["beta_end"],
        beta_schedule=SD["beta_schedule"],
        use_karras_sigmas=True,
    )
    model = load_model(scheduled(folder, tmp_path / "karras", scheduler))
    scheduler.set_timesteps(6)
    model, settings = for_settings(model, settings_of(6))
    found = [level.sigma for level in levels_for(model, settings, (CELLS, CELLS))]
    torch.testing.assert_close(torch.tensor(found), scheduler.sigmas, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("scheduler", "message"),
    [
        (diffusers.FlowMatchEulerDiscreteScheduler(), "class FlowMatchEulerDiscreteScheduler"),
        (diffusers.EDMEulerScheduler(**EDM), "class EDMEulerScheduler.*SDXL|class EDMEuler"),
        (diffusers.DPMSolverMultistepScheduler(**FLOW), "flow matching"),
    ],
)
def test_other_noise_is_refused_by_name(folder, tmp_path, scheduler, message):
    with pytest.raises(InputError, match=message):
        load_model(scheduled(folder, tmp_path / "other", scheduler))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sigma_data": 0.5}, r"sigma_data 0\.5 is not 1"),
        ({"prediction_type": "epsilon"}, "prediction_type 'epsilon' is not v_prediction"),
    ],
)
def test_edm_of_another_kind_is_refused(xl_folder, tmp_path, changes, message):
    scheduler = diffusers.EDMEulerScheduler(**EDM | changes)
    with pytest.raises(InputError, match=message):
        load_model(scheduled(xl_folder, tmp_path / "edm", scheduler))


def test_two_names_for_one_scheduler_are_refused(xl_folder, tmp_path):
    copy = Path(shutil.copytree(xl_folder, tmp_path / "two"))
    diffusers.EDMEulerScheduler(**EDM).save_pretrained(copy / "scheduler")
    with pytest.raises(InputError, match=r"DDIMScheduler, and scheduler_config\.json EDM"):
        load_model(copy)
    diffusers.DPMSolverMultistepScheduler().save_pretrained(copy / "scheduler")
    assert load_model(copy).predicts == "eps"  # the same noise by another name


def test_the_law_of_consensus_holds_for_each_kind_of_noise(folder, xl_folder, tmp_path):
    edm, lcm = diffusers.EDMEulerScheduler(**EDM), diffusers.LCMScheduler(**SD)
    pictures, start = drawn(3)
    for source in (
        folder,
        scheduled(xl_folder, tmp_path / "edm", edm, is_cosxl_edit=True),
        scheduled(folder, tmp_path / "lcm", lcm),
    ):
        model_laws.consensus_law_holds(load_model(source, micro_batch=VIEWS), pictures, start)


@pytest.mark.parametrize(
    "wrong",
    [
        {"beta_start": "0.1"},
        {"beta_end": math.nan},
        {"num_train_timesteps": -1},
        {"_class_name": "LCMScheduler", "original_inference_steps": 0},
        {"_class_name": "EDMEulerScheduler", "sigma_min": "a"},
    ],
)
def test_numbers_that_make_no_schedule_are_refused(wrong):
    with pytest.raises(InputError, match="scheduler"):
        noise_of(wrong, Path("scheduler"))
