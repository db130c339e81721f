"""Pictures, noise and steps of models in diffusers' layout, and of diffusers' own pipelines."""

from __future__ import annotations

from typing import Any

import torch
from biased_views import WIDTHS, Biased, assert_converges, sweep
from closeness import NETWORK, assert_near
from model_laws import run
from PIL import Image
from torch import Tensor

from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.protocol import levels_for


def pictures(views: int, height: int = 16, width: int = 24) -> Tensor:
    """Pictures of 8 bits, so that a pipeline that is given files sees the same numbers."""
    draws = torch.randint(
        256, (views, height, width, 3), generator=torch.Generator().manual_seed(1)
    )
    return draws / 255


def as_files(images: Tensor) -> list[Image.Image]:
    return [Image.fromarray((255 * image).round().byte().numpy()) for image in images]


def noise(model: Any, images: Tensor, seed: int = 2) -> Tensor:
    rows, columns = (side // model.cell for side in images.shape[1:3])
    shape = (len(images), model.vae.config.latent_channels, rows, columns)
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def states(model: Any, images: Tensor, start: Tensor, settings: SamplerSettings) -> list[Tensor]:
    """The latents after every step."""
    return [step.x for step in run(model, images, start, settings)]


def steps_of(scheduler: Any, patch: Any) -> list[Tensor]:
    """Everything that a pipeline's scheduler returns from now on, a step at a time."""
    recorded, step = [], scheduler.step

    def recording(*args: Any, **options: Any) -> Any:
        result = step(*args, **options)
        recorded.append(result[0].clone())
        return result

    patch.setattr(scheduler, "step", recording)
    return recorded


def assert_same_steps(ours: list[Tensor], theirs: list[Tensor]) -> None:
    assert len(ours) == len(theirs)
    for x, expected in zip(ours, theirs):
        assert_near(x, expected, NETWORK)


def assert_deviations_shrink(model: Any, steps: int) -> None:
    """The law of consensus, with this family's prediction at this family's noise levels."""
    settings = SamplerSettings(
        steps=steps, solver="euler", guidance_text=1.0, guidance_image=1.0, strength=1.0
    )
    levels = levels_for(model, settings, (64, 64))
    curve = sweep(Biased(model.schedule, model.predicts), settings, levels=levels)
    assert curve[0].amax() > 0.5  # there is something to agree on
    assert_converges(curve)
    torch.testing.assert_close(curve[-1], torch.zeros(len(WIDTHS), dtype=torch.float64))
