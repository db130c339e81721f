"""What a scene holds, in a few numbers."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from rasterizer.scene import Gaussians

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)

Quantiles = tuple[float, ...]
"""Values at QUANTILES."""


@dataclass(frozen=True)
class SceneSummary:
    """Counts of a scene, and the distributions of its values. Lengths are in world units."""

    gaussians: int
    sh_degree: int
    quantiles: Quantiles
    """QUANTILES, in [0, 1]."""
    x: Quantiles
    y: Quantiles
    z: Quantiles
    """Of the centres' coordinates."""
    opacity: Quantiles
    """In [0, 1]."""
    scale: Quantiles
    """Of the standard deviations along all three axes."""


def summarise(scene: Gaussians) -> SceneSummary:
    """The summary of a scene that is not empty."""
    return SceneSummary(
        len(scene),
        scene.degree,
        QUANTILES,
        *(quantiles_of(axis) for axis in scene.means.T),
        opacity=quantiles_of(scene.opacities),
        scale=quantiles_of(scene.scales.flatten()),
    )


def quantiles_of(values: Float[Tensor, " n"]) -> Quantiles:
    """The values at QUANTILES, nearest rank (torch.quantile refuses more than 2^24 values)."""
    ordered = values.double().sort().values
    return tuple(float(ordered[round(q * (len(ordered) - 1))]) for q in QUANTILES)
