"""Classifier-free guidance of InstructPix2Pix, and which of its branches a scale makes needless."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from gsedit.paper.diffusion.predictions import Prediction
from gsedit.paper.diffusion.schedules import Schedule


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
