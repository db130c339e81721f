"""The sky: a gradient from the horizon up, and clouds."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.colors import color
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.textures import Textures
from research.train_small.pictures.vectors import normalized


class Sky(NamedTuple):
    """Linear rgb at the horizon and above, and of clouds."""

    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]
    cloud: Float[Tensor, "3"]
    cover: float
    """From about -1, clear, to 1, half clouded."""
    texture: int
    """Texture of the clouds."""


def random_sky(rng: RandomStream, textures: Textures, studio: bool) -> Sky:
    """Blue more often than not outdoors, else of any two colors."""
    if rng.chance(0.65) and not studio:
        low = color(rng(0.52, 0.62), rng(0.0, 0.35), rng(0.75, 1.0))
        high = color(rng(0.55, 0.63), rng(0.2, 0.7), rng(0.5, 0.95))
    else:
        low, high = (color(rng(), rng() ** 2, rng(0.1, 1.0)) for _ in range(2))
    return Sky(
        low=torch.tensor(low),
        high=torch.tensor(high),
        cloud=torch.full((3,), rng(0.6, 1.3)),
        cover=rng(-0.5, 1.2),
        texture=textures.pick("cloud", rng),
    )


def sky_color(
    sky: Sky, textures: Textures, directions: Float[Tensor, "3 m"]
) -> Float[Tensor, "m 3"]:
    """Linear rgb of the sky in directions of any length; below the horizon as at it."""
    up = normalized(directions, dim=0)[2].clamp_min(0)
    rise = (2 * up).clamp_max(1).sqrt()[:, None]
    clear = sky.low * (1 - rise) + sky.high * rise
    clouds = textures.sample(sky.texture, directions[:2] / (up + 0.25) * 0.12)
    cover = ((clouds - 0.6 + 0.3 * sky.cover) * 4).clamp(0, 1)[:, None]
    return clear * (1 - cover) + sky.cloud * cover
