"""A bank of periodic textures, each in levels of blur, looked up where rays meet surfaces."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from research.train_small.pictures import patterns
from research.train_small.pictures.patterns import TILE
from research.train_small.pictures.random_stream import RandomStream

LEVELS = 6  # of blur: each twice as wide as the one before


class Textures(NamedTuple):
    """`n` grey patterns of TILE^2 texels, addressed by number, each in `l` = LEVELS of blur."""

    texels: Float[Tensor, " t"]
    """In [0, 1], flat: `n l s s`, by texture, level, row and column."""
    families: dict[str, tuple[int, ...]]
    """The numbers of patterns of one make."""

    def pick(self, family: str, rng: RandomStream) -> int:
        """The number of one of a family."""
        return rng.pick(self.families[family])

    def sample(
        self, texture: int, uv: Float[Tensor, "2 m"], level: Int[Tensor, " m"] | int = 0
    ) -> Float[Tensor, " m"]:
        """Its grey in [0, 1], of the nearest texel, at positions in repeats and a level of blur."""
        column = (uv[0] * TILE).long() & (TILE - 1)
        row = (uv[1] * TILE).long() & (TILE - 1)
        return self.texels[((texture * LEVELS + level) * TILE + row) * TILE + column]


def level_of(footprint: Float[Tensor, " m"]) -> Int[Tensor, " m"]:
    """The level whose blur is as wide as a ray's footprint in texels."""
    return footprint.clamp(1, 2 ** (LEVELS - 1)).log2().round().long()


def random_textures(rng: RandomStream) -> Textures:
    """A bank with some of every family."""
    made = {
        "cloud": [patterns.fractal(rng, rng(1.3, 2.0)) for _ in range(4)],
        "rough": [patterns.fractal(rng, rng(0.5, 1.1)) for _ in range(4)],
        "speckle": [patterns.speckle(rng, rng(0.6, 1.6), rng(0.8, 3.0)) for _ in range(4)],
        "blades": [patterns.blades(rng) for _ in range(3)],
        "leaves": [patterns.leaves(rng, count) for count in (150, 400, 900, 2000)],
        "cells": [patterns.cells(rng, count) for count in (60, 250, 900, 2500)],
        "cracks": [patterns.cracks(rng, rng(1.2, 1.8)) for _ in range(3)],
        "masonry": [patterns.masonry(rng, *laid) for laid in ((16, 8), (8, 8), (8, 1), (12, 4))],
        "wood": [patterns.wood(rng) for _ in range(2)],
        "print": [patterns.checks(8), patterns.lines(8), patterns.lines(16), patterns.dots(8)],
    }
    families, stack = {}, []
    for name, family in made.items():
        families[name] = tuple(range(len(stack), len(stack) + len(family)))
        stack += family
    return Textures(_blurred(torch.stack(stack)).flatten(), families)


def _blurred(tiles: Float[Tensor, "n s s"]) -> Float[Tensor, "n l s s"]:
    """Tiles in all levels; a Gaussian of half a level's footprint takes away what would alias."""
    spectrum = torch.fft.rfft2(tiles)
    blurs = [patterns.gaussian(0.5 * 2**level) for level in range(1, LEVELS)]
    return torch.stack([tiles, *(torch.fft.irfft2(spectrum * blur) for blur in blurs)], 1)
