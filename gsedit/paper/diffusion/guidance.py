"""Predictions of a network as the pair (x0, eps), and classifier-free guidance of InstructPix2Pix.

Of x_t = a x0 + b noise, a network may predict the noise, the clean latent, or one of two
combinations. Each is a linear map of the pair, and with x_t = a x0 + b eps it is solved for both.
Some branches are spared. `v` views, `c` channels, `y x` latent cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

Latents = Float[Tensor, "v c y x"]
Prediction = Literal["eps", "x0", "v", "flow"]
"""eps: the noise. x0: the clean latent. v = a eps - b x0 (Salimans and Ho 2022). flow = eps - x0,
the velocity dx/ds of a straight path (Liu et al. 2023)."""


class Pair(NamedTuple):
    """Two predictions that belong together: x_t = a x0 + b eps."""

    x0: Latents
    eps: Latents


def as_pair(kind: Prediction, predicted: Latents, x: Latents, level: NoiseLevel) -> Pair:
    """(x0, eps) of a prediction at x_t. Raises UsageError for eps where nothing is left of x0."""
    a, b = level.a, level.b
    match kind:
        case "eps":
            return Pair(clean_of(predicted, x, level), predicted)
        case "x0":
            return Pair(predicted, noise_of(predicted, x, level))
        case "v":
            unit = a * a + b * b
            return Pair((a * x - b * predicted) / unit, (b * x + a * predicted) / unit)
        case "flow":
            return Pair((x - b * predicted) / (a + b), (x + a * predicted) / (a + b))


def clean_of(eps: Latents, x: Latents, level: NoiseLevel) -> Latents:
    """x0 that belongs to x_t and eps. Raises UsageError where a is 0: x_t holds nothing of it."""
    if level.a == 0:
        raise UsageError(
            f"at t = {level.t:g} the terminal SNR is 0: a prediction of the noise says nothing of "
            "the picture there. Use strength below 1, a schedule that ends above 0, or a network "
            "that predicts v, x0 or flow"
        )
    return (x - level.b * eps) / level.a


def noise_of(x0: Latents, x: Latents, level: NoiseLevel) -> Latents:
    """eps that belongs to x_t and x0; b must not be 0."""
    return (x - level.a * x0) / level.b


class Need(NamedTuple):
    """Under which conditions a step needs a prediction."""

    text_image: bool = True
    image: bool = True
    none: bool = True


class Branches(NamedTuple):
    """The predictions under the three conditions; None where it is not needed."""

    text_image: Float[Tensor, "v c y x"] | None
    image: Float[Tensor, "v c y x"] | None
    none: Float[Tensor, "v c y x"] | None


def weights(s_T: float, s_I: float) -> tuple[float, float, float]:
    """Weights of the branches in the formula of `guide`; they sum to 1."""
    return s_T, s_I - s_T, 1 - s_I


def needed(s_T: float, s_I: float) -> Need:
    """The branches whose weight is not exactly 0.

    The unconditional one falls out at s_I = 1, whatever s_T; the image's at s_I = s_T, and the
    text's at s_T = 0. s_T = 1 alone spares nothing; with s_I = 1 only the text's is left.
    """
    return Need(*(weight != 0 for weight in weights(s_T, s_I)))


def guide(
    text_image: Float[Tensor, "*d"] | None,
    image: Float[Tensor, "*d"] | None,
    none: Float[Tensor, "*d"] | None,
    s_T: float,
    s_I: float,
) -> Float[Tensor, "*d"]:
    """e_u + s_I (e_I - e_u) + s_T (e_TI - e_I): eq. 3 of InstructPix2Pix, whichever s_T and s_I.

    A branch that is None must be one of those that `needed` leaves out; ValueError otherwise. The
    sum of weights is 1, so it does not matter whether eps, x0 or v are guided.
    """
    branches = (text_image, image, none)
    if any(need and branch is None for need, branch in zip(needed(s_T, s_I), branches)):
        raise ValueError(f"guidance {s_T:g} / {s_I:g} needs a branch that is missing")
    if text_image is not None and image is not None:  # differences lose fewer digits than products
        guided = image + s_T * (text_image - image)
        return guided if none is None else guided + (s_I - 1) * (image - none)
    weighted = [
        (weight, branch)
        for weight, branch in zip(weights(s_T, s_I), branches)
        if weight != 0 and branch is not None
    ]
    (first, guided), *others = weighted
    if first != 1:
        guided = first * guided
    for weight, branch in others:
        guided = guided + weight * branch
    return guided


@runtime_checkable
class Predictor(Protocol):
    """A diffusion model without its latent space: predictions, and what they are of. Stateless."""

    @property
    def name(self) -> str:
        """Named in error messages."""
        ...

    @property
    def schedule(self) -> Schedule:
        """The noise levels it was trained at."""
        ...

    @property
    def predicts(self) -> Prediction:
        """The quantity that `branches` returns."""
        ...

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The prediction at x_t under each condition in `need`, in any floating dtype.

        `t` is a training step, between two of them where the schedule is interpolated.
        """
        ...


class Around:
    """A predictor with the properties of another; classes that extend it have `branches`."""

    def __init__(self, network: Predictor) -> None:
        self.network = network

    @property
    def name(self) -> str:
        return self.network.name

    @property
    def schedule(self) -> Schedule:
        return self.network.schedule

    @property
    def predicts(self) -> Prediction:
        return self.network.predicts


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
            f"image guidance {s_I:g}: compute in float32, lower the guidance, or take more steps"
        )
