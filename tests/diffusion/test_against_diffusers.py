"""One tiny random network in diffusers' InstructPix2Pix pipeline and in our sampler.

Its text features are given, so the pipeline needs no text encoder.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import diffusers
import pytest
import torch
from tiny_models import tiny_unet

from gsedit.paper.diffusion.guidance import Branches
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

SD = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear", "steps_offset": 1}
DDIM = {**SD, "clip_sample": False, "set_alpha_to_one": False}
STEPS = 4
SIGMAS = 2e-6
"""Largest difference of latents, of the largest: sigmas of diffusers hold seven digits."""
STABLE_DIFFUSION = Schedule.scaled_linear()


def draw(*shape: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


VAE = diffusers.AutoencoderKL(block_out_channels=(32,))  # not used: latents go in and out
TEXT, NULL = draw(2, 1, 7, 32, seed=1)
IMAGES, NOISE = draw(2, 2, 4, 9, 8, seed=2)  # sides that are odd, and not equal


@dataclass(frozen=True, eq=False)
class Network:
    """Our contract over a bare UNet: text, null text, image latents."""

    unet: Any
    name: str = "tiny"
    schedule: Schedule = STABLE_DIFFUSION
    predicts: str = "eps"

    @torch.no_grad()
    def branches(self, x, t, condition, need):
        branches = ((TEXT, IMAGES), (NULL, IMAGES), (NULL, torch.zeros_like(IMAGES)))
        return Branches(
            *(
                self.unet(torch.cat((x, image), 1), t, text.expand(len(x), -1, -1)).sample
                if needed
                else None
                for needed, (text, image) in zip(need, branches)
            )
        )


@pytest.fixture(scope="module")
def network() -> Network:
    with torch.random.fork_rng():
        torch.manual_seed(0)  # the module offers no generator for its initial weights
        unet = tiny_unet()
    return Network(unet.eval().double())


def theirs(network: Network, scheduler: Any, settings: SamplerSettings) -> torch.Tensor:
    pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
        unet=network.unet, vae=VAE, text_encoder=None, tokenizer=None, scheduler=scheduler,
        safety_checker=None, feature_extractor=None, requires_safety_checker=False,
    )  # fmt: skip
    pipe.set_progress_bar_config(disable=True)
    return pipe(
        prompt_embeds=TEXT.expand(2, -1, -1),
        negative_prompt_embeds=NULL.expand(2, -1, -1),
        image=IMAGES,  # four channels: taken for latents
        num_inference_steps=settings.steps,
        guidance_scale=settings.scales[0],
        image_guidance_scale=settings.scales[1],
        latents=NOISE.clone(),
        generator=torch.Generator().manual_seed(5),
        output_type="latent",
    ).images


def ours(network: Network, settings: SamplerSettings) -> torch.Tensor:
    first = levels_of(network.schedule, settings)[0]
    # diffusers starts the leading spacing as if noise had unit power, the others as if it had b^2
    x = NOISE if settings.spacing == "leading" else first.b * NOISE
    fresh = torch.Generator().manual_seed(5)
    *_, state = sample(network, None, x, settings, generator=fresh)
    return state.x


def settings(solver: str, spacing: str, s_T: float = 7.5, s_I: float = 1.5) -> SamplerSettings:
    return SamplerSettings(
        steps=STEPS, solver=solver, spacing=spacing, guidance_text=s_T, guidance_image=s_I,
        strength=1.0, consensus=False,
    )  # fmt: skip


def scheduler(solver: str, spacing: str) -> Any:
    match solver:
        case "ddim":
            return diffusers.DDIMScheduler(**DDIM, timestep_spacing=spacing)
        case "euler":
            return diffusers.EulerDiscreteScheduler(**SD, timestep_spacing=spacing)
        case "ancestral":
            return diffusers.EulerAncestralDiscreteScheduler(**SD, timestep_spacing=spacing)
        case "heun":
            return diffusers.HeunDiscreteScheduler(**SD, timestep_spacing=spacing)
    return diffusers.DPMSolverMultistepScheduler(
        **SD, timestep_spacing=spacing, final_sigmas_type="zero"
    )


def assert_equal(found: torch.Tensor, expected: torch.Tensor) -> None:
    """Compare latents by their size: networks are in float64, sigmas of diffusers in float32."""
    apart = (found - expected).abs().amax() / expected.abs().amax()
    assert found.dtype == torch.float64
    assert apart < SIGMAS


@pytest.mark.parametrize(
    ("solver", "spacing", "s_T", "s_I"),  # every scale with every solver
    [
        ("ddim", "leading", 7.5, 1.5), ("ddim", "leading", 7.5, 1.0), ("ddim", "leading", 3.0, 2.0),
        ("euler", "linspace", 7.5, 1.5), ("euler", "leading", 7.5, 1.0),
        ("euler", "trailing", 3.0, 2.0),
        ("ancestral", "linspace", 7.5, 1.5), ("ancestral", "leading", 7.5, 1.0),
        ("ancestral", "linspace", 3.0, 2.0),
        ("heun", "linspace", 7.5, 1.5), ("heun", "linspace", 7.5, 1.0),
        ("heun", "trailing", 3.0, 2.0),
    ],
)  # fmt: skip
def test_latents_equal_diffusers(network, solver, spacing, s_T, s_I):
    chosen = settings(solver, spacing, s_T, s_I)
    assert_equal(ours(network, chosen), theirs(network, scheduler(solver, spacing), chosen))


def test_karras_sigmas_equal_diffusers(network):
    chosen = settings("euler", "karras")
    known = diffusers.EulerDiscreteScheduler(**SD, use_karras_sigmas=True)
    known.set_timesteps(STEPS)
    levels = levels_of(network.schedule, chosen)
    # theirs come from 1 - ab in float32, which at ab = 0.999 has lost three digits
    assert [level.sigma for level in levels] == pytest.approx(known.sigmas.tolist(), rel=1e-4)
    # they interpolate log(sigma) between training steps, we sigma: a hundredth of a step at most
    times = [level.t for level in levels[:-1]]
    assert times == pytest.approx(known.timesteps.tolist(), abs=0.01)


@pytest.mark.parametrize(
    ("solver", "s_I"), [("ddim", 0.0), ("euler", 0.99), ("euler", 0.0), ("ancestral", 0.99)]
)
def test_image_guidance_below_one_guides(network, solver, s_I):
    """There diffusers silently drops all guidance. The formula has no such case, nor have we."""
    spacing = "leading" if solver == "ddim" else "linspace"
    chosen = settings(solver, spacing, 7.5, s_I)
    steps = scheduler(solver, spacing)
    steps.set_timesteps(STEPS)
    x = NOISE * steps.init_noise_sigma
    fresh = torch.Generator().manual_seed(5)
    for t in steps.timesteps:  # their scheduler, and every branch of the formula
        shown = steps.scale_model_input(x, t)
        text, image, none = network.branches(shown, t, None, (True,) * 3)
        eps = none + s_I * (image - none) + 7.5 * (text - image)
        draws = {} if solver == "euler" else {"generator": fresh}
        x = steps.step(eps, t, x, **draws).prev_sample
    found = ours(network, chosen)
    assert_equal(found, x)
    unguided = theirs(network, scheduler(solver, spacing), chosen)
    assert_equal(ours(network, settings(solver, spacing, 1.0, 1.0)), unguided)
    assert (found - unguided).abs().max() > 0.1
