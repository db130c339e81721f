"""The cost of sampling with a denoiser, measured by one evaluation for the views of a batch.

`v` views of `h w` pixels, `c y x` latents.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.guidance import needed
from gsedit.diffusion.guided import branches_of, predict_guided
from gsedit.diffusion.memory import most_bytes
from gsedit.diffusion.precision import InBfloat16
from gsedit.diffusion.schedules import NoiseLevel
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import Cost, Denoiser
from gsedit.editors.ranked import Fit, prepared


@torch.no_grad()
def measure_cost(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
    levels: Sequence[NoiseLevel],
    known: dict[Any, Fit],
) -> Cost:
    """The cost of sampling these views between these levels. Draws nothing."""
    predictor, spent = prepared(denoiser, x, originals, prompt, settings, known)
    evaluations = len(x) * sum(needed(*settings.scales))
    started = time.monotonic()
    condition = denoiser.condition(originals, prompt, torch.Generator())
    condition_s = (time.monotonic() - started) / len(x)

    def predict() -> Tensor:
        return predict_guided(predictor, condition, x, levels[0], settings)

    mirrored = originals[:1].flip(2)  # no picture that was encoded before
    encode = _seconds(lambda: denoiser.encode(mirrored))
    decode = _seconds(lambda: denoiser.decode(x[:1]))
    evaluation = min(_seconds(predict), _seconds(predict))  # the first may compile
    return Cost(
        steps=len(levels) - 1,
        evaluations=sum(branches_of(levels, settings)),
        evaluation_s=evaluation / evaluations,
        encode_s=encode,
        decode_s=decode,
        peak_bytes=most_bytes(),
        precision="bfloat16" if isinstance(predictor, InBfloat16) else "float32",
        spent=spent + 2 * evaluations,
        condition_s=condition_s,
    )


def _seconds(work: Callable[[], Any]) -> float:
    started = time.monotonic()
    work()
    return time.monotonic() - started
