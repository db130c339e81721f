"""A denoiser made ready for this machine: as many views at once as fit, in an exact precision.

`v` views of `h w` pixels, `c y x` latents.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.diffusion.guidance import Predictor, needed
from gsedit.paper.diffusion.guided import predict_guided
from gsedit.paper.diffusion.memory import peak_bytes, views_at_once
from gsedit.paper.diffusion.precision import InBfloat16, with_precision
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.protocol import Denoiser, levels_for


@dataclass(frozen=True)
class Fit:
    """How a denoiser fits this machine."""

    view_bytes: int
    """The most memory that a pass or a decoding of one view takes."""
    rounded: bool
    """Whether it is exact enough in bfloat16, and faster."""


class Prepared(NamedTuple):
    """A predictor for a batch, and the evaluations that it took to find it."""

    predictor: Predictor
    evaluations: int


def prepared(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
    known: dict[Any, Fit],
) -> Prepared:
    """The denoiser with as many views in a pass as fit in memory, and in bfloat16 if that is exact
    enough (see gsedit.paper.diffusion.precision).

    A denoiser that runs a network (with_micro_batch is declared) is measured on the first view:
    the memory of a pass and of a decoding, and the error of bfloat16. `known` keeps what was
    measured, for other batches of the same size and settings. Others are left alone.
    """
    with_micro_batch = denoiser.capabilities.with_micro_batch
    if with_micro_batch is None:
        return Prepared(denoiser, 0)
    key, evaluations = (x.shape[1:], settings), 0
    if key not in known:
        known[key], evaluations = _fit(denoiser, x, originals, prompt, settings)
    fit = known[key]
    sized = with_micro_batch(views_at_once(len(x), fit.view_bytes, settings.memory))
    return Prepared(InBfloat16(sized) if fit.rounded else sized, evaluations)


def _fit(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
) -> tuple[Fit, int]:
    """Measure a denoiser on the first view, see `prepared`; the evaluations that it takes."""
    rows, columns = x.shape[2:]
    first = levels_for(denoiser, settings, (rows, columns))[0]
    condition = denoiser.condition(originals[:1], prompt, torch.Generator())
    predictions = 0

    def predict(predictor: Predictor) -> Tensor:
        nonlocal predictions
        predictions += 1
        return predict_guided(predictor, condition, x[:1], first, settings)

    is_auto = settings.precision == "auto"
    asked = denoiser if is_auto else with_precision(denoiser, predict, settings.precision)
    once = cache(lambda: predict(asked))

    def guided(predictor: Predictor) -> Tensor:
        return once() if predictor is asked else predict(predictor)

    held = max(peak_bytes(once), peak_bytes(lambda: denoiser.decode(x[:1])))
    chosen = with_precision(denoiser, guided, settings.precision) if is_auto else asked
    return Fit(held, chosen is not denoiser), predictions * sum(needed(*settings.scales))
