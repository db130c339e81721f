"""Lighting by sun and sky: how much of either reaches a point, and the color it reflects."""

from __future__ import annotations

from math import pi, radians
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.intersect import box_depth
from research.train_small.pictures.materials import Material
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import BOX, Solids
from research.train_small.pictures.vectors import direction, normalized

PENUMBRA = 0.15  # of a ball's radius: how soft the shadows of round things are


class Lighting(NamedTuple):
    """A sun and a sky; linear rgb."""

    toward: Float[Tensor, "3"]
    """The sun's direction, unit."""
    sun: Float[Tensor, "3"]
    sky: Float[Tensor, "3"]
    dapple: float
    """How much of the sun is blocked by leaves, in spots: a share in [0, 1]."""


class Received(NamedTuple):
    """How much light reaches points: shares in [0, 1]."""

    sun: Float[Tensor, " m"]
    sky: Float[Tensor, " m"]


def random_lighting(rng: RandomStream) -> Lighting:
    """A sun high or low, bright or behind clouds, warm or cold."""
    azimuth, elevation = rng(0, 2 * pi), radians(rng(15, 85))
    overcast = rng.chance(0.3)
    strength = rng(0.05, 0.4) if overcast else rng(0.6, 1.6)
    warm = rng(-0.12, 0.2)
    return Lighting(
        toward=torch.tensor(direction(azimuth, elevation)),
        sun=strength * torch.tensor((1 + warm, 1.0, 1 - 1.2 * warm)),
        sky=rng(0.25, 0.7) * torch.tensor((1 - rng(-0.05, 0.15), 1.0, 1 + rng(-0.05, 0.25))),
        dapple=rng(0.4, 1.0) if rng.chance(0.3) else 0.0,
    )


def sun_share(
    solids: Solids, points: Float[Tensor, "m 3"], toward: Float[Tensor, "3"]
) -> Float[Tensor, " m"]:
    """The share of the sun that solids let through to points (world units): balls, and drums taken
    for balls, throw soft shadows, boxes hard ones."""
    flat = solids.kind == BOX
    start, along = solids.local(points), solids.to_local @ toward[:, None]
    ahead = box_depth(solids.to_local[flat], start[flat], toward[:, None].expand(3, len(points)))
    start, along = start[~flat], along[~flat]
    a, b = along.square().sum(1), (start * along).sum(1)
    radius = solids.taper[~flat].clamp_max(1).sqrt()[:, None]
    passing = (start.square().sum(1) - b * b / a) / radius**2  # squared, in radii
    depth = ((1 - passing.clamp_min(0).sqrt()) / PENUMBRA).clamp(0, 1)
    before = ((-b / a.sqrt()) / 0.2).clamp(0, 1)  # not behind the point
    return (1 - depth * before).prod(0) * (ahead == torch.inf).all(0)


def sky_share(
    solids: Solids, points: Float[Tensor, "m 3"], normals: Float[Tensor, "m 3"]
) -> Float[Tensor, " m"]:
    """The share of the sky that solids leave free, taking each for a ball of its mean size."""
    radius = solids.half.prod(-1).pow(1 / 3).clamp_max(0.5)[:, None]
    offset = solids.center[:, None] - points
    square = offset.square().sum(-1).clamp_min(1e-6)
    facing = (offset * normals).sum(-1) / square.sqrt()
    cover = (radius**2 / square).clamp_max(1) * (0.15 + facing).clamp(0, 1)
    return (1 - 0.8 * cover).clamp_min(0.15).prod(0)


def reflected(
    material: Material,
    lighting: Lighting,
    color: Float[Tensor, "m 3"],
    height: Float[Tensor, " m"],
    normals: Float[Tensor, "m 3"],
    directions: Float[Tensor, "m 3"],
    received: Received,
) -> Float[Tensor, "m 3"]:
    """Linear rgb of points of one material, lit by Blinn and Phong's model.

    `height` is the texture's, in [0, 1]; `directions` are those of the rays that see the points.
    """
    bump = material.bump * (height - 0.5)
    direct = (normals @ lighting.toward + bump).clamp_min(0) * received.sun
    ambient = (0.55 + 0.45 * normals[:, 2]) * received.sky * (1 + bump)
    lit = color * (direct[:, None] * lighting.sun + ambient[:, None] * lighting.sky)
    if not material.specular:
        return lit
    half = normalized(lighting.toward - normalized(directions, dim=-1), dim=-1)
    highlight = (normals * half).sum(-1).clamp_min(0) ** material.shininess
    return lit + (highlight * received.sun * material.specular)[:, None] * lighting.sun
