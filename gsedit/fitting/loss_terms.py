"""The loss of the update as text: terms and their weights. Loads no torch."""

from __future__ import annotations

from math import isfinite
from typing import Literal, NamedTuple, cast, get_args

from gsedit.errors import UsageError

LossName = Literal["mse", "l1", "dssim", "gram", "perceptual"]


class LossTerm(NamedTuple):
    """One term of a sum."""

    name: LossName
    weight: float = 1.0


def parse_loss(text: str) -> tuple[LossTerm, ...]:
    """The terms of "mse+gram" or "0.8*l1 + 0.2*dssim", in their order.

    Raises UsageError for a name that is none of `LossName` or is there twice, and for a weight that
    is not a number of 0 or more.
    """
    terms = tuple(_parse_term(part.strip(), text) for part in text.split("+"))
    names = [term.name for term in terms]
    if len(set(names)) < len(names):
        raise UsageError(f"the loss {text!r} has a term twice: give each once, with its weight")
    return terms


def _parse_term(part: str, text: str) -> LossTerm:
    factor, star, name = (piece.strip() for piece in part.rpartition("*"))
    names = get_args(LossName)
    if name not in names:
        raise UsageError(
            f"the loss {text!r} has a term {name!r}: give {', '.join(names)}, joined by +, as in "
            "l1+perceptual or 0.8*l1+0.2*dssim"
        )
    try:
        weight = float(factor) if star else 1.0
    except ValueError:
        weight = -1.0
    if not (isfinite(weight) and weight >= 0):
        raise UsageError(f"the loss {text!r}: the weight {factor!r} is no number of 0 or more")
    return LossTerm(cast(LossName, name), weight)
