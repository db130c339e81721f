"""Scheduler classes: each gives its own noise, step for step as in diffusers, or is refused."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import diffusers
import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_models import PROMPT, SD

from gsedit.errors import InputError
from gsedit.paper.diffusion.sampler import sample
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.protocol import levels_for
from gsedit.paper.models.loading import load_model
from gsedit.paper.models.stable_diffusion import noise_of

pytestmark = pytest.mark.usefixtures("offline")
CELLS = (16, 16)
DDIM = {"_class_name": "DDIMScheduler"}


def scheduled(source: Path, folder: Path, scheduler) -> Path:
    """A copy of a model with another scheduler."""
    shutil.copytree(source, folder)
    scheduler.save_pretrained(folder / "scheduler")
    path = folder / "model_index.json"
    named = {"scheduler": ["diffusers", type(scheduler).__name__]}
    path.write_text(json.dumps(json.loads(path.read_text()) | named))
    return folder


@pytest.mark.parametrize(
    "changes", [{"set_alpha_to_one": True}, {"prediction_type": "v_prediction"}]
)
def test_the_last_latents_equal_diffusers(pipeline, folder, tmp_path, changes):
    scheduler = diffusers.DDIMScheduler(**{**SD, **changes})
    model = load_model(scheduled(folder, tmp_path / "other", scheduler))
    pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
        **{**pipeline.components, "scheduler": scheduler}, requires_safety_checker=False
    )
    pipe.set_progress_bar_config(disable=True)
    g = torch.Generator().manual_seed(3)
    pictures, start = torch.rand(2, 32, 32, 3, generator=g), torch.randn(2, 4, *CELLS, generator=g)
    expected = pipe(
        [PROMPT] * 2, image=pictures.movedim(-1, 1), num_inference_steps=2, guidance_scale=5.0,
        image_guidance_scale=1.5, latents=start, output_type="latent",
    ).images  # fmt: skip
    asked = SamplerSettings(
        steps=2, guidance_text=5.0, guidance_image=1.5, strength=1.0, consensus=False
    )
    settings = asked.with_defaults(model.capabilities.defaults)
    condition = model.condition(pictures, PROMPT, torch.Generator())
    levels = levels_for(model, settings, CELLS)
    *_, last = sample(model, condition, start, settings, levels=levels)
    assert_near(last.x, expected, NETWORK)


def test_spacings_are_the_scheduler_s(folder, tmp_path):
    trailing = diffusers.DDIMScheduler(**SD, timestep_spacing="trailing")
    betas = {name: SD[name] for name in ("beta_start", "beta_end", "beta_schedule")}
    karras = diffusers.EulerDiscreteScheduler(**betas, use_karras_sigmas=True)
    found = []
    for number, scheduler in enumerate((trailing, karras)):
        model = load_model(scheduled(folder, tmp_path / str(number), scheduler))
        scheduler.set_timesteps(7)
        asked = SamplerSettings(steps=7, strength=1.0)
        asked = asked.with_defaults(model.capabilities.defaults)
        found.append(levels_for(model, asked, CELLS))
    assert [level.t for level in found[0][:-1]] == trailing.timesteps.tolist()
    sigmas = torch.tensor([level.sigma for level in found[1]])
    torch.testing.assert_close(sigmas, karras.sigmas, rtol=1e-4, atol=1e-6)


def test_zero_terminal_snr_is_read():
    noise = noise_of(DDIM | SD | {"rescale_betas_zero_snr": True}, Path("scheduler"))
    assert float(noise.schedule.alphas_cumprod[-1]) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"_class_name": "FlowMatchEulerDiscreteScheduler"}, "FlowMatchEulerDiscreteScheduler, wh"),
        ({"_class_name": "LCMScheduler"}, "is a LCMScheduler, which gsedit does not run"),
        ({"use_flow_sigmas": True}, "of flow matching"),
        ({"prediction_type": "sample"}, "prediction_type"),
        ({"beta_schedule": "unknown"}, "cannot be loaded"),
        ({"beta_start": "0.1"}, "scheduler"),
        ({"beta_end": math.nan}, "correct them"),
        ({"num_train_timesteps": -1}, "scheduler"),
    ],
)
def test_what_is_no_noise_of_stable_diffusion_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        noise_of(DDIM | SD | changes, Path("scheduler"))
