"""A stage as its camera sees it: what every ray meets, its geometry and its color."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from research.train_small.pictures.backdrops import backdrop_depth
from research.train_small.pictures.intersect import first_solid
from research.train_small.pictures.lighting import Received, reflected, sky_share, sun_share
from research.train_small.pictures.materials import albedo
from research.train_small.pictures.palette import BACKDROP, GROUND
from research.train_small.pictures.sky import sky_color
from research.train_small.pictures.stage import Stage
from research.train_small.pictures.surfaces import solid_normals, surface_uv, turned_to_view
from research.train_small.pictures.textures import Textures
from research.train_small.pictures.vectors import normalized
from research.train_small.sources import FAR

STRIP = 64  # rows of rays at once: their numbers stay in a second-level cache
ON_GROUND, ON_BACKDROP = 1000, 2000  # what a ray meets if no solid: backdrop i is ON_BACKDROP + i
NOTHING = -1


class RaySamples(NamedTuple):
    """Colors and surfaces along `m` rays, row by row."""

    rgb: Float[Tensor, "m 3"]
    """Linear RGB of each ray."""
    depth: Float[Tensor, " m"]
    """In distances of the subject; at most FAR."""
    normal: Float[Tensor, "m 3"]
    """Unit, in the world; 0 in the sky."""
    subject: Float[Tensor, " m"]
    """1 on the subject, else 0."""


class Hits(NamedTuple):
    """Ends of rays in world units."""

    directions: Float[Tensor, "3 m"]
    """Directions of unit depth."""
    depth: Float[Tensor, " m"]
    """inf in the sky."""
    what: Int[Tensor, " m"]
    """A solid's number, ON_GROUND, ON_BACKDROP + a backdrop's number, or NOTHING."""
    points: Float[Tensor, "m 3"]
    """In the sky the camera's origin."""


def ray_cast(stage: Stage, textures: Textures, size: int) -> RaySamples:
    """Cast size^2 rays, row by row; `size` is even."""
    strips = stage.camera.rays(size).split(STRIP * size, -1)
    parts = [_cast_rows(stage, textures, xy, size) for xy in strips]
    return RaySamples(*(torch.cat(column) for column in zip(*parts)))


def _cast_rows(stage: Stage, textures: Textures, xy: Float[Tensor, "2 m"], size: int) -> RaySamples:
    """Cast some rows of `size` rays."""
    hits = first_hits(stage, textures, xy)
    normals = _normals(stage, hits)
    subject = torch.zeros_like(hits.depth)
    on_solid = _on_solid(hits)
    subject[on_solid] = stage.solids.subject[hits.what[on_solid]].float()
    depth = (hits.depth / stage.camera.distance).clamp_max(FAR)
    return RaySamples(_colors(stage, textures, hits, normals, size), depth, normals, subject)


def first_hits(stage: Stage, textures: Textures, xy: Float[Tensor, "2 m"]) -> Hits:
    """Find the first hit of every ray; `xy` is its direction at unit depth, in the camera's
    axes."""
    camera = stage.camera
    directions = camera.directions(xy)
    ground = -camera.origin[2] / directions[2].clamp_max(-1e-6)
    ground = ground.masked_fill(directions[2] > -1e-4, torch.inf)  # the horizon
    depth = torch.full_like(ground, torch.inf)
    what = torch.full_like(ground, NOTHING, dtype=torch.long)
    candidates: list[tuple[Tensor, Tensor | int]] = [(ground, ON_GROUND)]
    for i, backdrop in enumerate(stage.backdrops):
        candidates.append((backdrop_depth(backdrop, textures, camera, directions), ON_BACKDROP + i))
    candidates.append(first_solid(stage.solids, camera, xy))
    for other, name in candidates:
        what = torch.where(other < depth, name, what)
        depth = torch.where(other < depth, other, depth)
    points = camera.origin[:, None] + depth.nan_to_num(posinf=0.0) * directions
    return Hits(directions, depth, what, points.T.contiguous())


def _on_solid(hits: Hits) -> Int[Tensor, " p"]:
    """The numbers of the rays that meet a solid."""
    return ((hits.what >= 0) & (hits.what < ON_GROUND)).nonzero().squeeze(-1)


def _normals(stage: Stage, hits: Hits) -> Float[Tensor, "m 3"]:
    """Unit normals toward the camera; 0 in the sky."""
    normals = torch.zeros_like(hits.points)
    normals[hits.what == ON_GROUND, 2] = 1
    for i, backdrop in enumerate(stage.backdrops):
        normals[hits.what == ON_BACKDROP + i] = backdrop.normal
    rows = _on_solid(hits)
    if len(rows):
        outward = solid_normals(stage.solids, hits.points[rows], hits.what[rows], stage.crease)
        normals[rows] = turned_to_view(outward, hits.directions[:, rows].T)
    return normalized(normals, dim=-1)


def _colors(
    stage: Stage, textures: Textures, hits: Hits, normals: Float[Tensor, "m 3"], size: int
) -> Float[Tensor, "m 3"]:
    """Linear rgb of rays in rows of `size`."""
    rgb = sky_color(stage.sky, textures, hits.directions)
    number_of = _material_numbers(stage, textures, hits)
    received = _received(stage, textures, hits.points, normals, size)
    slant = (-(normals * hits.directions.T).sum(-1)).clamp_min(0.15)
    footprint = hits.depth / (stage.camera.focal * size) / slant.sqrt()
    for number, material in enumerate(stage.materials):
        rows = (number_of == number).nonzero().squeeze(-1)
        if not len(rows):
            continue
        normal, view = normals[rows], hits.directions[:, rows].T
        color, height = albedo(
            material, textures, surface_uv(hits.points[rows], normal), footprint[rows]
        )
        shares = Received(*(share[rows] for share in received))
        rgb[rows] = reflected(material, stage.lighting, color, height, normal, view, shares)
    return rgb


def _material_numbers(stage: Stage, textures: Textures, hits: Hits) -> Int[Tensor, " m"]:
    """The number of the material that each ray meets; -1 in the sky."""
    numbers = torch.cat((stage.solids.material, torch.tensor([-1])))  # the last: all but solids
    material = numbers[hits.what.clamp(-1, len(numbers) - 1)]
    ground = (hits.what == ON_GROUND).nonzero().squeeze(-1)
    patchy = textures.sample(stage.sky.texture, hits.points[ground, :2].T * 0.13) > 0.5
    material[ground] = torch.where(patchy, stage.patch, GROUND)
    for i in range(len(stage.backdrops)):
        material[hits.what == ON_BACKDROP + i] = BACKDROP + i
    return material


def _received(
    stage: Stage,
    textures: Textures,
    points: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    size: int,
) -> Received:
    """The light at all points, interpolated from every other one of both axes."""
    coarse, upright = (
        grid.reshape(-1, size, 3)[::2, ::2].reshape(-1, 3) for grid in (points, normals)
    )
    lighting, solids = stage.lighting, stage.solids
    sun = sun_share(solids, coarse + 0.01 * upright, lighting.toward)
    if lighting.dapple:
        height = coarse[:, 2:] / lighting.toward[2].clamp_min(0.3)
        foot = coarse[:, :2] - height * lighting.toward[:2]  # where the sun would meet the ground
        leaves = textures.sample(stage.sky.texture, foot.T * 0.35)
        sun = sun * (1 - lighting.dapple * ((leaves - 0.45) * 8).clamp(0, 1))
    pair = torch.stack((sun, sky_share(solids, coarse, upright))).reshape(1, 2, -1, size // 2)
    fine = torch.nn.functional.interpolate(pair, scale_factor=2, mode="bilinear")
    return Received(*fine.reshape(2, -1))
