"""Guided predictions of a network, and which of their branches are spared.

`v` views, `c` channels, `y x` latent cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Latents, Need, Predictor, guide, needed
from gsedit.paper.diffusion.schedules import NoiseLevel
from gsedit.paper.diffusion.settings import SamplerSettings

TEXT_ALONE = Need(True, False, False)


class Guided:
    """The guided predictions of one sampling, asked for in the order of its steps.

    Below the settings' guidance_end there is no guidance. With guidance_every above 1, what
    guidance added to the prediction under text and picture is added again to the next ones.
    """

    def __init__(self, denoiser: Predictor, condition: Any, settings: SamplerSettings) -> None:
        self._denoiser, self._condition, self._settings = denoiser, condition, settings
        self._calls = 0
        self._push: Latents | None = None

    def __call__(self, x: Latents, level: NoiseLevel) -> Latents:
        """The prediction, in the dtype of x. Raises UsageError if it is not finite."""
        need = _need(self._settings, self._calls, level)
        is_spared = _is_spared(self._settings, self._calls, level)
        self._calls += 1
        branches = self._denoiser.branches(x, level.t, self._condition, need)
        dtype = next(branch.dtype for branch in branches if branch is not None)
        text_image, image, none = (b if b is None else b.to(x.dtype) for b in branches)
        if is_spared and text_image is not None:
            push = None if level.sigma < self._settings.guidance_end else self._push
            guided = text_image if push is None else text_image + push
        else:
            guided = guide(text_image, image, none, *self._settings.scales)
            self._push = None if text_image is None else guided - text_image
        name = f"{self._denoiser.name}'s prediction (in {dtype})"
        check_finite(guided, name, level, self._settings)
        return guided


def predict_guided(
    denoiser: Predictor, condition: Any, x: Latents, level: NoiseLevel, settings: SamplerSettings
) -> Latents:
    """One guided prediction, in the dtype of x. Raises UsageError if it is not finite."""
    return Guided(denoiser, condition, settings)(x, level)


def branches_of(levels: Sequence[NoiseLevel], settings: SamplerSettings) -> list[int]:
    """How many branches each prediction of a sampling between these levels computes."""
    asked: list[NoiseLevel] = []
    for here, there in pairwise(levels):
        is_corrected = settings.method == "heun" and there.b != 0 and there != here
        asked += [here, there] if is_corrected else [here]
    return [sum(_need(settings, call, level)) for call, level in enumerate(asked)]


def _need(settings: SamplerSettings, call: int, level: NoiseLevel) -> Need:
    """The branches that this call of a sampling computes."""
    need = needed(*settings.scales)
    return TEXT_ALONE if need.text_image and _is_spared(settings, call, level) else need


def _is_spared(settings: SamplerSettings, call: int, level: NoiseLevel) -> bool:
    """Whether this call of a sampling computes no guidance."""
    return level.sigma < settings.guidance_end or call % settings.guidance_every > 0


def check_finite(x: Latents, what: str, level: NoiseLevel, settings: SamplerSettings) -> None:
    """Raise UsageError, with the settings that did it, for latents that are not finite."""
    # one sum is not finite where a number is not; a sum that overflows is out of bounds too
    if not torch.isfinite(x.sum()):
        s_T, s_I = settings.scales
        raise UsageError(
            f"{what} at t = {level.t:g} (sigma {level.sigma:.3g}) are not finite, with solver "
            f"{settings.method}, {settings.step_count} steps, guidance {s_T:g} and "
            f"image guidance {s_I:g}: compute in float32, lower the guidance, "
            "or take more steps"
        )
