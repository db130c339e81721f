"""Large Gaussians become several small ones, which can have colors of their own: patterns that are
finer than the Gaussians of a scene cannot appear in it.

`n` Gaussians before, `m` after.
"""

from __future__ import annotations

from dataclasses import replace
from math import log, sqrt

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians, concatenate

OFFSET = 0.75
"""The two halves of a Gaussian lie so many standard deviations off its center, along its longest
axis, and are shorter there by as much as leaves the second moment of both together what it was."""
LENGTH = sqrt(1 - OFFSET**2)
"""Length of a half along that axis, in lengths of the whole."""
LONG = 1.15
"""Times its longest wanted axis from which a Gaussian is divided: a half has LENGTH times its own.
"""
MOST_LONG = 8.0
"""Times from which a longer axis makes a Gaussian no more urgent."""
ROUNDS = 8
"""Times that a Gaussian is halved at most: it is then less than a fifth as long on all axes."""
MOST_AT_ONCE = 0.6
"""Share of the Gaussians that are halved in a round: the most urgent come first."""


@torch.no_grad()
def divided(
    scene: Gaussians, longest: Float[Tensor, " n"], worth: Float[Tensor, " n"], most: int
) -> tuple[Gaussians, Int[Tensor, " m"]]:
    """Divide Gaussians until no axis is much longer than `longest` (standard deviation, world
    units), or there are `most`; those of the greatest `worth` and length first, none without worth.

    Returns the scene, whose pictures change little, and the row before of each Gaussian.
    """
    origin = torch.arange(len(scene))
    for _ in range(ROUNDS):
        ratio = scene.scales.amax(-1) / longest.clamp_min(1e-12)
        urgent = torch.where(ratio > LONG, worth * (ratio.clamp_max(MOST_LONG) - 1), 0.0)
        count = min(most - len(scene), int((urgent > 0).sum()), int(MOST_AT_ONCE * len(scene)))
        if count <= 0:
            break
        picked = urgent.topk(count).indices
        kept = torch.ones(len(scene), dtype=torch.bool).index_fill(0, picked, False)
        rows = torch.cat((kept.nonzero().squeeze(-1), picked, picked))
        scene = concatenate(scene[rows[: -2 * count]], *halved(scene[picked]))
        worth = torch.where(kept, worth, worth / 2)[rows]
        longest, origin = longest[rows], origin[rows]
    return scene, origin


def halved(parents: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Two for each, along its longest axis: together they have its mass (the integral of its
    opacity), mean and covariance."""
    longest, axis = parents.scales.max(-1)
    rotation = rotation_matrices(parents.quats)
    direction = rotation.gather(2, axis[:, None, None].expand(-1, 3, 1)).squeeze(-1)
    offset = OFFSET * longest[:, None] * direction
    shorter = torch.nn.functional.one_hot(axis, 3) * log(LENGTH)
    opacity = parents.opacities / (2 * LENGTH)
    half = replace(
        parents, log_scales=parents.log_scales + shorter, logit_opacities=torch.logit(opacity)
    )
    return replace(half, means=half.means - offset), replace(half, means=half.means + offset)
