"""Growths by name, as a table of data: where they lie, how thick, of what they are made.

`m` places on a surface; shares are in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
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


LEAST, MOST = 0.1, 5.0
"""Range of the factor of a usual thickness."""
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Growth:
    """Something that lies or grows on surfaces; lengths are shares of what it is on."""

    where: Callable[[Spots], Float[Tensor, " m"]]
    body: Literal["layer", "tufts", "leaves"]
    thickness: float
    """Height over the surface, far from the edges; of leaves, their length."""
    grain: float
    """Distance of its Gaussians along the surface, if there are not too many."""
    shade: Rgb
    """Display color in the shade, for a light of 1; above 1 it outshines haze before it."""
    lit: Rgb
    """Display color in the light."""
    requirement: str
    """Surface that it needs, as the error says it: "nothing inside ..."."""
    opacity: float = 0.985
    mottle: float = 0.02
    """Standard deviation of the brightness from Gaussian to Gaussian."""
    edge: float = 0.5
    """Least share of a place at which it lies there."""
    around: bool = False
    """Whether it grows on walls too; else only on what is seen from above."""
    hides: bool = True
    """Whether the Gaussians under it take its color."""
    each: int = 1
    """Gaussians a pixel, at most."""
    smooth: int = 6
    """Rounds of smoothing of the surface under it, over a pixel each."""


GROWTHS: dict[str, Growth] = {
    "snow": Growth(
        snowy, "layer", 0.04, 0.004, (0.63, 0.72, 0.9), (0.975, 0.98, 0.99),
        "faces up and sees the sky", smooth=16,
    ),
    "moss": Growth(
        mossy, "tufts", 0.008, 0.0045, (0.2, 0.27, 0.09), (0.45, 0.53, 0.2),
        "is damp and shaded", mottle=0.16, around=True, each=2,
    ),
    "dust": Growth(
        dusty, "layer", 0.003, 0.004, (0.56, 0.53, 0.48), (0.82, 0.77, 0.69),
        "faces up", opacity=0.58, mottle=0.04, edge=0.1,
    ),
    "ice": Growth(
        icy, "layer", 0.006, 0.004, (0.55, 0.74, 0.92), (0.88, 0.97, 1.06),
        "faces up and sees the sky", opacity=0.34, mottle=0.08, hides=False,
    ),
    "leaves": Growth(
        littered, "leaves", 0.045, 0.006, (0.75, 0.72, 0.72), (1.0, 1.0, 1.0),
        "is level and sees the sky", mottle=0.12, edge=0.2, hides=False,
    ),
}  # fmt: skip
"""Growths by the names that sentences give them."""


def growth_of(name: str, amount: float) -> Growth:
    """The growth of a name. Raises UsageError for an unknown one, or an amount out of range."""
    if name not in GROWTHS:
        raise UsageError(f"there is no growth {name!r}: choose one of {', '.join(GROWTHS)}")
    if not LEAST <= amount <= MOST:
        raise UsageError(
            f"{name} {amount:g} times as thick as usual is out of range: say {LEAST:g} to {MOST:g}"
        )
    return GROWTHS[name]
