"""Shares, in [0, 1], of places on a surface that each growth lies on. `m` places."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import step
from gsedit.objects.growth.spots import Spots


def snowy(spots: Spots) -> Float[Tensor, " m"]:
    """Snow: on places that face up and are open above."""
    soft = 0.07 * spots.noise(0.06, 1) + 0.04 * spots.noise(0.02, 9)
    lying = step(spots.rise + soft, 0.44, 0.72)
    return lying * step(spots.overhead, 0.1, 0.4) * spots.earthly


def dusty(spots: Spots) -> Float[Tensor, " m"]:
    """Dust: on places that face up, under a roof too, and in hollows; most on level ones."""
    soft = 0.15 * spots.noise(0.03, 2)
    lying = step(spots.rise + soft, 0.1, 0.6)
    hollows = step(spots.openness, 0.7, 0.3) * step(spots.rise, -0.3, 0.2)
    return torch.maximum(lying, 0.8 * hollows) * spots.earthly


def mossy(spots: Spots) -> Float[Tensor, " m"]:
    """Moss: on damp places, which are low, in crevices or turned from the light, in clumps; more on
    ledges than on walls, and none below."""
    shade = step(spots.light() / spots.site.exposure, 0.9, 0.45)
    crevices = step(spots.openness, 0.75, 0.3)
    low = step(spots.height, 0.35, 0.02)
    ledge = step(spots.rise, 0.1, 0.75)
    damp = 0.5 * shade + 0.55 * crevices + 0.5 * low + 0.45 * ledge
    clumps = 0.75 * damp + 0.2 * spots.noise(0.09, 3) + 0.1 * spots.noise(0.03, 4)
    return step(clumps, 0.35, 0.6) * step(spots.rise, -0.35, 0.0) * spots.earthly


def icy(spots: Spots) -> Float[Tensor, " m"]:
    """Ice: a glaze on places that are open above and not turned down."""
    soft = 0.12 * spots.noise(0.05, 5)
    return step(spots.rise + soft, 0.0, 0.35) * step(spots.overhead, 0.1, 0.4) * spots.earthly


def littered(spots: Spots) -> Float[Tensor, " m"]:
    """Leaves: on places that are about level and open above, in drifts."""
    level = step(spots.rise, 0.7, 0.9)
    drifts = 0.75 + 0.25 * spots.noise(0.2, 6)
    return (level * step(spots.overhead, 0.1, 0.4) * drifts).clamp(0, 1) * spots.earthly
