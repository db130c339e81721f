"""Random pictures with exact depth, normals and masks, from a seed."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.camera_response import camera_response
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.ray_casting import RaySamples, ray_cast
from research.train_small.pictures.stage import random_stage
from research.train_small.pictures.textures import Textures, random_textures
from research.train_small.pictures.vectors import normalized
from research.train_small.sources import Sources, cat

SUPERSAMPLE = 2  # rays a pixel and axis
ATTEMPTS = 20  # at a picture that its subject neither leaves empty nor fills
BRIGHTEST = 4.0  # linear: highlights are cut off before they are averaged


@torch.no_grad()
def procedural(count: int, size: int, generator: torch.Generator) -> Sources:
    """`count` random pictures of size^2 pixels, all with textures of one bank."""
    textures = random_textures(RandomStream(generator))
    rng = RandomStream(generator)
    return cat([_as_sources(_random_picture(textures, size, rng), size, rng) for _ in range(count)])


def _random_picture(textures: Textures, size: int, rng: RandomStream) -> RaySamples:
    """Sub-pixels of a picture whose subject covers 3 % to 70 % of it (in the last of ATTEMPTS, any
    share)."""
    for _ in range(ATTEMPTS):
        picture = ray_cast(random_stage(rng, textures), textures, size * SUPERSAMPLE)
        if 0.03 < float(picture.subject.mean()) < 0.7:
            break
    return picture


def _as_sources(picture: RaySamples, size: int, rng: RandomStream) -> Sources:
    """Sub-pixels averaged to size^2 pixels, colors through a random camera response."""
    subject = _pooled(picture.subject, size)
    image = camera_response(_pooled(picture.rgb.clamp_max(BRIGHTEST), size), subject, rng)
    normal = normalized(_pooled(picture.normal, size), dim=-1)
    depth = _pooled(picture.depth, size)
    return Sources(image[None], depth[None], normal[None], subject[None])


def _pooled(fine: Float[Tensor, "m ..."], size: int) -> Float[Tensor, "h w c"]:
    """The mean over the SUPERSAMPLE^2 sub-pixels of each of size^2 pixels."""
    return fine.reshape(size, SUPERSAMPLE, size, SUPERSAMPLE, -1).mean((1, 3))
