"""Gaussians that the update leaves alone, because the edited views hardly show them.

`n` Gaussians, `v` views of `p` pixels in the survey.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.savings.decision import Bound, Decision, LeftOut

FAINT = 1e-4
"""The Gaussians that are left out carry together at most this share of each picture."""


def faint_gaussians(shares: Float[Tensor, "v n"]) -> Bool[Tensor, " n"]:
    """As many Gaussians as together carry at most `FAINT` of each picture, the faintest first.

    `shares`: the sum of a Gaussian's blending weights in a view, over the view's pixels. In every
    view, the sum over those that are left out is at most the sum of their largest shares.
    """
    largest = shares.amax(0)
    order = largest.argsort()
    left = torch.zeros(len(largest), dtype=torch.bool)
    left[order[largest[order].double().cumsum(0) <= FAINT]] = True
    return left


def decide_cells(gaussians: int, cells: int) -> Decision:
    """Of the Gaussians of a large scene, which is edited as so many `cells`."""
    if cells == gaussians:
        return Decision("cells", False, "Needed: a scene of so few Gaussians is edited as it is")
    return Decision(
        "cells",
        True,
        "Most are smaller than the pixels of the edit: neighbours are surveyed and fitted together "
        "as one, and each takes its share of the change. The error was measured (docs/scale.md), "
        "it has no proven bound",
        (LeftOut(gaussians - cells, gaussians, "Gaussians"),),
        1 - cells / gaussians,
        "the Gaussians of the survey and the update",
    )


def decide_gaussians(
    left: Bool[Tensor, " n"],
    shares: Float[Tensor, "v n"],
    covered: Float[Tensor, "v p"],
    brightest: float,
) -> Decision:
    """Of the Gaussians that are `left` out of the update.

    `covered`: the sum of their blending weights at each pixel, W. Without them those behind show
    through: their weights, and the background's, grow by W in total, since all weights of a pixel
    add up to 1. What goes and what comes are two sums of colours of weight W each, so that the
    pixel changes by at most W times the largest colour, `brightest`.
    """
    number = int(left.sum())
    if not number:
        return Decision("gaussians", False, "Needed: the edited views show every Gaussian")
    unseen = int((shares[:, left].amax(0) == 0).sum())
    error = float(covered.double().square().mean(1).amax().sqrt()) * brightest
    return Decision(
        "gaussians",
        True,
        f"No edited view sees {unseen:,} of them, and the others carry at most {FAINT:.2%} of a "
        "picture together: the update does not move them",
        (LeftOut(number, len(left), "Gaussians"),),
        number / len(left),
        "the Gaussians of the update",
        Bound(error, "RMSE of an edited view"),
    )
