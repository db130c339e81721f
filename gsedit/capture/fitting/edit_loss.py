"""Loss of a step of the update: a sum of terms between crops and their targets.

Pictures are `h w 3` in [0, 1]; `*n` any leading axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.settings import LossTerm, UpdateSettings
from gsedit.errors import UsageError
from gsedit.measures import losses
from gsedit.measures.features import FeatureExtractor
from gsedit.measures.perceptual import INSTALL, is_installed, perceptual_distance

SIMPLE = {"mse": losses.mse, "l1": losses.l1, "dssim": losses.dssim}


def check_installed(settings: UpdateSettings) -> None:
    """Raise UsageError where the loss needs weights that are not there."""
    if any(term.name == "perceptual" for term in settings.terms) and not is_installed():
        raise UsageError(f"the loss perceptual needs weights that are not installed: {INSTALL}")


def edit_loss(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    terms: Sequence[LossTerm],
    features: FeatureExtractor,
) -> Float[Tensor, ""]:
    """The weighted sum of the terms, each a mean over the pictures; `features` are Gram's.

    mse + lambda gram is eq. (loss) of Efficient-NeRF2NeRF, l1 + perceptual the loss of
    Instruct-NeRF2NeRF, 0.8 l1 + 0.2 dssim that of 3D Gaussian splatting. Raises UsageError for
    perceptual without its weights.
    """
    parts = [
        value if term.weight == 1 else term.weight * value
        for term in terms
        for value in [_loss(term.name, features)(image, target)]
    ]
    return sum(parts[1:], parts[0])


def _loss(name: str, features: FeatureExtractor) -> Callable[[Tensor, Tensor], Tensor]:
    if name in SIMPLE:
        return SIMPLE[name]
    if name == "gram":
        return lambda image, target: losses.gram_loss(
            *(features(t.reshape(-1, *t.shape[-3:]).movedim(-1, 1)) for t in (image, target))
        )
    distance = perceptual_distance()
    if distance is None:
        raise UsageError(f"the loss perceptual needs weights that are not installed: {INSTALL}")
    return distance
