"""Losses between a picture and its target, all differentiable, and their weighted sums by name.

Pictures are `h w 3` in [0, 1]; `*n` any leading axes; features `c` channels. Loads no torch: a
shell asks for the settings at every Tab.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from gsedit.errors import UsageError
from gsedit.scene.shapes import Float, Tensor

if TYPE_CHECKING:
    from gsedit.measures.features import FeatureExtractor


def mse(image: Float[Tensor, "*s"], target: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """Mean squared error over all elements; the color term of eq. (loss)."""
    return _mean((image - target).square())


def l1(image: Float[Tensor, "*s"], target: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """Mean absolute error over all elements."""
    return _mean((image - target).abs())


def ssim(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> Float[Tensor, ""]:
    """Mean structural similarity, in [-1, 1]; sides of 6 pixels or more (reflected at borders)."""
    from kornia.metrics import ssim as ssim_map

    a, b = (t.reshape(-1, *t.shape[-3:]).movedim(-1, 1) for t in (image, target))
    return _mean(ssim_map(a, b, 11, max_val=1.0))  # the window of Wang et al. 2004


def dssim(image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]) -> Float[Tensor, ""]:
    """1 - SSIM, in [0, 2]: the "D-SSIM" that 3D Gaussian splatting trains with (weight 0.2).

    The literature's DSSIM is half of this.
    """
    return 1 - ssim(image, target)


def gram(features: Float[Tensor, "*n c h w"]) -> Float[Tensor, "*n c c"]:
    """Correlations of the channels, averaged over positions: divided by h w, and not by c."""
    rows = features.flatten(-2)
    return rows @ rows.mT / rows.shape[-1]


def gram_loss(
    features: list[Float[Tensor, "n _c _h _w"]], targets: list[Float[Tensor, "n _c _h _w"]]
) -> Float[Tensor, ""]:
    """Mean squared difference of Gram matrices, one a picture; summed over layers: the style loss
    of Johnson et al. 2016, whose matrices are divided by c too, but whose squares are summed."""
    import torch

    return torch.stack(
        [mse(gram(f), gram(t)) for f, t in zip(features, targets, strict=True)]
    ).sum()


def style(
    image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"], features: FeatureExtractor
) -> Float[Tensor, ""]:
    """The Gram loss of pictures, on their features."""
    pictures = (each.reshape(-1, *each.shape[-3:]).movedim(-1, 1) for each in (image, target))
    return gram_loss(*map(features, pictures))


def perceptual(
    image: Float[Tensor, "*n h w 3"], target: Float[Tensor, "*n h w 3"]
) -> Float[Tensor, ""]:
    """The learned distance. Raises UsageError where its weights are not installed."""
    from gsedit.measures.perceptual import INSTALL, perceptual_distance

    distance = perceptual_distance()
    if distance is None:
        raise UsageError(f"the loss perceptual needs weights that are not installed: {INSTALL}")
    return distance(image, target)


def _mean(values: Float[Tensor, "*s"]) -> Float[Tensor, ""]:
    """The mean, axis by axis: of many values at once, torch's depends on the number of threads."""
    while values.ndim:
        values = values.mean(-1)
    return values


LOSSES: dict[str, Callable[..., Tensor]] = {
    "mse": mse, "l1": l1, "dssim": dssim, "gram": style, "perceptual": perceptual,
}  # fmt: skip
"""Losses of pictures by their names in --loss."""
GRAM_WEIGHT = 30.0
"""Weight of gram where no number is before it (lambda of eq. (loss) of Efficient-NeRF2NeRF). The
paper's 0.1 changes nothing on features of the pictures' own energy."""


class LossTerm(NamedTuple):
    """One term of a sum."""

    name: str
    weight: float = 1.0


def parse_loss(text: str) -> tuple[LossTerm, ...]:
    """The terms of "mse+30*gram" or "0.8*l1 + 0.2*dssim", in their order.

    Without a number before it a term has the weight 1, gram 30. Terms of weight 0 are left out.

    Raises UsageError for a name that is none of `LOSSES` or is there twice, for a weight that
    is not a number of 0 or more, and where no term has a weight above 0.
    """
    terms = tuple(_parse_term(part.strip(), text) for part in text.split("+"))
    names = [term.name for term in terms]
    if len(set(names)) < len(names):
        raise UsageError(f"the loss {text!r} has a term twice: give each once, with its weight")
    left = tuple(term for term in terms if term.weight)
    if not left:
        raise UsageError(f"the loss {text!r} has no term of a weight above 0")
    return left


def _parse_term(part: str, text: str) -> LossTerm:
    factor, star, name = (piece.strip() for piece in part.rpartition("*"))
    if name not in LOSSES:
        raise UsageError(
            f"the loss {text!r} has a term {name!r}: give {', '.join(LOSSES)}, joined by +, as in "
            "l1+perceptual or 0.8*l1+0.2*dssim"
        )
    try:
        weight = float(factor) if star else GRAM_WEIGHT if name == "gram" else 1.0
    except ValueError:
        weight = -1.0
    if not (isfinite(weight) and weight >= 0):
        raise UsageError(f"the loss {text!r}: the weight {factor!r} is no number of 0 or more")
    return LossTerm(name, weight)


def edit_loss(
    image: Float[Tensor, "*n h w 3"],
    target: Float[Tensor, "*n h w 3"],
    terms: Sequence[LossTerm],
    features: FeatureExtractor,
) -> Float[Tensor, ""]:
    """The weighted sum of the terms, each a mean over the pictures; `features` are Gram's.

    mse + lambda gram is eq. (loss) of Efficient-NeRF2NeRF, l1 + perceptual the loss of
    Instruct-NeRF2NeRF, 0.8 l1 + 0.2 dssim that of 3D Gaussian splatting.
    """
    parts = []
    for name, weight in terms:
        value = LOSSES[name](image, target, *([features] if name == "gram" else []))
        parts.append(value if weight == 1 else weight * value)
    return sum(parts[1:], parts[0])
