"""Bands of spherical harmonics that no picture shows.

`n` Gaussians, `k` coefficients a channel, `d` degrees from 1 on.
"""

from __future__ import annotations

from math import isqrt, pi, sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.savings.decision import Bound, Decision, LeftOut

INVISIBLE = 1 / 510
"""Of a colour in [0, 1]: half a step of an 8-bit picture."""


def band_colours(sh: Float[Tensor, "n k 3"]) -> Float[Tensor, "n d"]:
    """The most that each degree adds to a colour, in any direction and channel.

    By Cauchy-Schwarz: the squares of a degree's 2 d + 1 harmonics add up to (2 d + 1) / (4 pi) in
    every direction (the addition theorem).
    """
    degrees = range(1, isqrt(sh.shape[1]))
    columns = [
        sh[:, d * d : (d + 1) ** 2].norm(dim=1).amax(-1) * sqrt((2 * d + 1) / (4 * pi))
        for d in degrees
    ]
    return torch.stack(columns, -1) if columns else sh.new_zeros(len(sh), 0)


def tail_colours(sh: Float[Tensor, "n k 3"], seen: Bool[Tensor, " n"]) -> list[float]:
    """By degree, from 1 on: the most that it and all higher ones together add to the colour of any
    Gaussian that is `seen`."""
    tails = band_colours(sh)[seen].flip(-1).cumsum(-1).flip(-1)
    return tails.amax(0).tolist() if len(tails) else [0.0] * tails.shape[1]


def needed_coefficients(sh: Float[Tensor, "n k 3"], seen: Bool[Tensor, " n"]) -> int:
    """The coefficients a channel that are drawn and fitted, without the highest degrees that
    together add at most `INVISIBLE` to the colour of any Gaussian that is `seen`."""
    tails = tail_colours(sh, seen)
    degree = next((i for i, colour in enumerate(tails) if colour <= INVISIBLE), len(tails))
    return (degree + 1) ** 2


def decide_bands(
    sh: Float[Tensor, "n k 3"], seen: Bool[Tensor, " n"], kept: int, travel: float
) -> Decision:
    """Of `kept` coefficients a channel.

    A pixel is a sum of colours whose weights add up to at most 1, and clamping at 0 brings colours
    no farther apart, so that no pixel changes by more than a colour. `travel`: how far the update
    could have moved a coefficient (see `adam_travel`), which adds to the bound.
    """
    total = sh.shape[1]
    if total == 1:
        return Decision("sh-bands", False, "There are none: no colour depends on the view")
    tails = tail_colours(sh, seen)
    if kept == total:
        reason = f"Needed: the highest band adds up to {tails[-1]:.2g} to a colour"
        return Decision("sh-bands", False, reason)
    first = isqrt(kept)
    trained = travel * sum((2 * d + 1) / sqrt(4 * pi) for d in range(first, len(tails) + 1))
    shown = tails[first - 1]
    what = f"add at most {shown:.2g} to a colour" if shown else "are zero"
    return Decision(
        "sh-bands",
        True,
        f"They {what} and stay in the file as they are",
        (LeftOut(total - kept, total, "coefficients a channel"),),
        3 * (total - kept) / (1 + 3 * total),
        "what the optimiser holds",
        Bound(
            min(1.0, shown + trained),
            f"of a pixel's colour ({shown:.2g} now, the rest if the update used them in full)",
        ),
    )


def adam_travel(rates: Float[Tensor, " t"], beta1: float = 0.9, beta2: float = 0.999) -> float:
    """The farthest that Adam moves a number in these steps, whatever its gradients are.

    Step t moves it by rate_t |m_t| / sqrt(v_t), where m_t and v_t are averages of the gradients and
    of their squares with weights a_i and b_i: at most sqrt(sum a_i^2 / b_i), by Cauchy-Schwarz.
    """
    steps = torch.arange(len(rates), dtype=torch.float64) + 1
    ratio = beta1**2 / beta2
    squares = (1 - beta1) ** 2 / (1 - beta2) * (1 - ratio**steps) / (1 - ratio)
    correction = (1 - beta2**steps) / (1 - beta1**steps) ** 2
    return float(rates.double() @ (squares * correction).sqrt())
