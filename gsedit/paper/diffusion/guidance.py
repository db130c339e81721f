"""Predictions of a network as the pair (x0, eps), and classifier-free guidance of InstructPix2Pix.

Of x_t = a x0 + b noise, a network may predict the noise, the clean latent, or one of two
combinations. Each is a linear map of the pair, and with x_t = a x0 + b eps it is solved for both.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.schedules import NoiseLevel, Schedule

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
