"""Upright planes behind the subject, with ragged upper edges: trees, hills, walls."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.camera import Pinhole
from research.train_small.pictures.materials import Material
from research.train_small.pictures.palette import VEGETATION, WALLS
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.textures import Textures


class Backdrop(NamedTuple):
    """An upright plane; world units."""

    away: tuple[float, float]
    """Its horizontal unit normal, away from the camera."""
    offset: float
    """Distance from the world's origin along `away`."""
    height: float
    ragged: float
    """How far the upper edge goes up and down, as a share of the height."""
    edge: int
    """The texture that the edge follows."""
    material: Material

    @property
    def normal(self) -> Float[Tensor, "3"]:
        """Toward the camera, unit."""
        return torch.tensor((-self.away[0], -self.away[1], 0.0))


def random_backdrops(
    rng: RandomStream, textures: Textures, heading: float, floor: Material | None
) -> list[Backdrop]:
    """Up to three across a view's heading (radians), one behind another; in a studio one high
    wall, more often than not of its floor's material."""
    studio = floor is not None
    made = []
    for i in range(1 if studio else rng.pick((0, 1, 1, 2, 3))):
        angle, offset = heading + rng(-0.6, 0.6), rng(1.5, 4.0) + 3.0 * i
        wall = studio or (i == 0 and rng.chance(0.25))
        maker = rng.pick(WALLS if wall else VEGETATION)
        material = floor if floor and rng.chance(0.6) else maker(rng, textures)
        height = 50.0 if studio else rng(0.5, 6.0)
        edge = textures.pick("cloud", rng)
        ragged = 0.0 if wall else rng(0.2, 0.9)
        made.append(Backdrop((cos(angle), sin(angle)), offset, height, ragged, edge, material))
    return made


def backdrop_depth(
    backdrop: Backdrop, textures: Textures, camera: Pinhole, directions: Float[Tensor, "3 m"]
) -> Float[Tensor, " m"]:
    """Depths at which rays meet a backdrop below its edge; inf where they do not."""
    nx, ny = backdrop.away
    x, y, z = camera.origin
    toward = nx * directions[0] + ny * directions[1]
    depth = (backdrop.offset - nx * x - ny * y) / toward
    up = z + depth * directions[2]
    height = backdrop.height
    if backdrop.ragged:
        u = (y + depth * directions[1]) * nx - (x + depth * directions[0]) * ny
        uv = torch.stack((u, up)).clamp(-1e4, 1e4).nan_to_num() * (0.25 / height)
        height = height * (1 + backdrop.ragged * (2 * textures.sample(backdrop.edge, uv) - 1))
    missed = ~(depth > 0) | (up > height) | (up < 0)
    return depth.masked_fill(missed, torch.inf)
