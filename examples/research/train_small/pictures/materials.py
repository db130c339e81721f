"""Materials: two textures, a ramp of colors, a highlight."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.patterns import TILE
from research.train_small.pictures.textures import Textures, level_of

DRIFT_REPEATS = 0.23  # of the slow drift of brightness, per world unit


class Material(NamedTuple):
    """Two textures blended, their grey looked up in a ramp, over a slow drift of brightness."""

    textures: tuple[int, int]
    repeats: tuple[float, float]
    """Repeats of the two textures per world unit."""
    share: float
    """Share of the second texture, in [0, 1]."""
    ramp: Float[Tensor, "c 3"]
    """Linear rgb of dark, ..., light texels."""
    drift_texture: int
    drift: float
    """Brightness is between 1 - drift and 1 + drift."""
    specular: float
    """Strength of the highlight."""
    shininess: float
    """Its exponent: the larger, the smaller the highlight."""
    bump: float
    """How much the texture tilts the shading."""


def albedo(
    material: Material,
    textures: Textures,
    uv: Float[Tensor, "2 m"],
    footprint: Float[Tensor, " m"],
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """Linear rgb and the texture's height in [0, 1] at surface coordinates, where a ray is as wide
    as its footprint; both in world units."""

    def grey(texture: int, repeats: float) -> Float[Tensor, " m"]:
        return textures.sample(texture, uv * repeats, level_of(footprint * (TILE * repeats)))

    first, second = (grey(*layer) for layer in zip(material.textures, material.repeats))
    height = first * (1 - material.share) + second * material.share
    brightness = 1 + material.drift * (2 * grey(material.drift_texture, DRIFT_REPEATS) - 1)
    return _interpolated(material.ramp, height) * brightness[:, None], height


def _interpolated(ramp: Float[Tensor, "c 3"], at: Float[Tensor, " m"]) -> Float[Tensor, "m 3"]:
    """Between the two nearest colors of a ramp over [0, 1]."""
    position = at.clamp(0, 1) * (len(ramp) - 1)
    below = position.long().clamp_max(len(ramp) - 2)
    rest = (position - below)[:, None]
    return ramp[below] * (1 - rest) + ramp[below + 1] * rest
