"""The loss of the update as text: terms and their weights. Loads no torch."""

from __future__ import annotations

from math import isfinite
from typing import Literal, NamedTuple, cast, get_args

from gsedit.errors import UsageError

LossName = Literal["mse", "l1", "dssim", "gram", "perceptual"]
GRAM_WEIGHT = 30.0
"""Weight of gram where no number is before it (lambda of eq. (loss) of Efficient-NeRF2NeRF). The
paper's 0.1 changes nothing on features of the pictures' own energy."""


class LossTerm(NamedTuple):
    """One term of a sum."""

    name: LossName
    weight: float = 1.0


def parse_loss(text: str) -> tuple[LossTerm, ...]:
    """The terms of "mse+30*gram" or "0.8*l1 + 0.2*dssim", in their order.

    Without a number before it a term has the weight 1, gram 30. Terms of weight 0 are left out.

    Raises UsageError for a name that is none of `LossName` or is there twice, for a weight that
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
    names = get_args(LossName)
    if name not in names:
        raise UsageError(
            f"the loss {text!r} has a term {name!r}: give {', '.join(names)}, joined by +, as in "
            "l1+perceptual or 0.8*l1+0.2*dssim"
        )
    try:
        weight = float(factor) if star else GRAM_WEIGHT if name == "gram" else 1.0
    except ValueError:
        weight = -1.0
    if not (isfinite(weight) and weight >= 0):
        raise UsageError(f"the loss {text!r}: the weight {factor!r} is no number of 0 or more")
    return LossTerm(cast(LossName, name), weight)
