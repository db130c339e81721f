"""Random pictures with exact depth, normals and masks, from a seed."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from train_small.pictures.develop import developed
from train_small.pictures.randomness import Dice
from train_small.pictures.shoot import Picture, shoot
from train_small.pictures.stage import random_stage
from train_small.pictures.textures import Textures, random_textures
from train_small.pictures.vectors import normalized
from train_small.sources import Sources, cat

SUPERSAMPLE = 2  # rays a pixel and axis
ATTEMPTS = 20  # at a picture whose subject is neither lost nor all that is to be seen
BRIGHTEST = 4.0  # linear: highlights are cut off before they are averaged


@torch.no_grad()
def procedural(count: int, size: int, generator: torch.Generator) -> Sources:
    """`count` random pictures of size^2 pixels, all with textures of one bank."""
    textures = random_textures(Dice(generator))
    dice = Dice(generator)
    return cat(
        [_developed(_random_picture(textures, size, dice), size, dice) for _ in range(count)]
    )


def _random_picture(textures: Textures, size: int, dice: Dice) -> Picture:
    """Sub-pixels of a picture whose subject is to be seen, but does not fill it."""
    for _ in range(ATTEMPTS):
        picture = shoot(random_stage(dice, textures), textures, size * SUPERSAMPLE)
        if 0.03 < float(picture.subject.mean()) < 0.7:
            break
    return picture


def _developed(picture: Picture, size: int, dice: Dice) -> Sources:
    """Sub-pixels averaged to size^2 pixels, colours as a camera would show them."""
    subject = _pooled(picture.subject, size)
    image = developed(_pooled(picture.rgb.clamp_max(BRIGHTEST), size), subject, dice)
    normal = normalized(_pooled(picture.normal, size), dim=-1)
    depth = _pooled(picture.depth, size)
    return Sources(image[None], depth[None], normal[None], subject[None])


def _pooled(fine: Float[Tensor, "m ..."], size: int) -> Float[Tensor, "h w c"]:
    """The mean over the SUPERSAMPLE^2 sub-pixels of each of size^2 pixels."""
    return fine.reshape(size, SUPERSAMPLE, size, SUPERSAMPLE, -1).mean((1, 3))
