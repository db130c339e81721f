"""Puddles: still water on level ground, which mirrors the scene that stands around it.

Reflections are exact pictures: the scene's mirror image in the plane of the water, seen from its
cameras. Each Gaussian's colors in them are fitted with spherical harmonics. `m` Gaussians, `v`
cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.around import cameras_of
from gsedit.datasets.dataset import evenly_spaced
from gsedit.objects.growth.layer import Patch, discs
from gsedit.objects.growth.table import Growth
from gsedit.scene.color_space import srgb_of_linear
from gsedit.scene.planes import refined_plane
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.surface.directions import look_up
from gsedit.surface.relief import FEWEST, without_specks
from gsedit.surface.surroundings import Surroundings, surroundings_at
from rasterizer.camera import Camera
from rasterizer.harmonics import basis
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

DEGREE = 3
"""SH degree of what mirrors."""
VIEWS, VIEW_PIXELS = 64, 48
"""Most cameras that reflections are taken from, and the longer side of their pictures: finer ones
hold more than SH of degree 3 can show, which would be noise."""
WAVER = 3.0
"""Distance from the plane, in pixels, up to which ground is level with it."""
HEAD_ON, GRAZING = 0.8, 3.0
"""Share that water mirrors seen from above, more than physics' 0.02 as a puddle is looked at for
that; and the power of 1 - cosine that takes it to 1 at grazing angles."""
NEAR = 0.02
"""Distance from the middle of the water, in the part's size, from which its surroundings count."""
STIFF = (1e-4, 1e-3, 2e-3, 4e-3)
"""Penalty of the squared coefficients of each degree, against the mean squared error."""
FULL = 0.85
"""Share of the roughness of the ground that is under water: the rest stands out of it."""
LIFT = 0.7
"""Height of the water over that, in pixels: a floor without roughness is under water too."""
WET, DAMP, WETTED = 3, 0.3, 0.45
"""Pixels around water that are wet, the opacity there, and the factor of display colors."""
MARGIN = 2.0
"""Height over the water, in pixels, under which nothing is mirrored: it is the shore itself."""
ROWS = 2048
"""Gaussians that are fitted at once."""


@dataclass(frozen=True, eq=False)
class Water:
    """A level plane of water: points with `normal @ x = offset`."""

    normal: Float[Tensor, "3"]
    offset: float

    def mirror(self) -> Similarity:
        """The reflection in the plane."""
        unit = self.normal.numpy()
        return Similarity(np.eye(3) - 2 * np.outer(unit, unit), 1.0, 2 * self.offset * unit)


def level(patch: Patch) -> Patch:
    """The part of a patch that lies under one level plane of water, with the water's depth."""
    relief = patch.relief
    if int(patch.lies.sum()) < FEWEST:
        return replace(patch, lies=torch.zeros_like(patch.lies))
    plane = _plane(patch)
    depth = plane.offset - relief.points @ plane.normal
    lies = patch.lies & (depth > 0) & (depth < 2 * WAVER * relief.pixel)
    lies = ~without_specks(~without_specks(lies)) & relief.there
    height = depth / (relief.axis @ plane.normal) * lies
    return replace(patch, lies=lies, height=height, share=patch.share * lies)


def water(
    scene: Gaussians,
    patch: Patch,
    growth: Growth,
    cameras: Sequence[Camera],
    execution: Execution = AUTO,
) -> Gaussians:
    """Still water over a level patch, and wet ground around it."""
    if not bool(patch.lies.any()):
        return scene[:0]
    relief, points = patch.relief, patch.top.points[patch.lies]
    plane = _through(points, patch.site.up)
    bottom = patch.spots(relief).mean(patch.site.setting.colors)
    bottom = bottom * torch.tensor(growth.lit).double()
    seen_from = cameras_of(scene, cameras, VIEWS, VIEW_PIXELS, execution)
    over = scene[scene.means.double() @ plane.normal - plane.offset > MARGIN * relief.pixel]
    near = NEAR * patch.site.size
    middle = points.mean(0).to(scene.means)
    around = surroundings_at(over, middle, near, plane.normal, execution, seen_from)
    sh = _reflecting(over, plane, points, bottom, seen_from, around, execution)
    flat = discs(points, plane.normal.expand_as(points), relief, growth.opacity, bottom)
    return concatenate(replace(flat, sh=sh.float()), _wet(patch, growth, sh.shape[1]))


def _through(points: Float[Tensor, "m 3"], up: Float[Tensor, "3"]) -> Water:
    """The plane that points are on."""
    level = float((points @ up).median())
    far = float((points @ up - level).abs().max()) + 1.0
    normal, offset = refined_plane(points.numpy(), up.numpy(), level, far)
    return Water(torch.from_numpy(normal), float(offset))


def _wet(patch: Patch, growth: Growth, k: int) -> Gaussians:
    """Dark wet ground around water, with `k` SH coefficients."""
    around = torch.nn.functional.max_pool2d(patch.lies[None, None].double(), 2 * WET + 1, 1, WET)
    water = float(patch.top.heights[patch.lies].median())
    level = (patch.relief.heights - water).abs() < WAVER * patch.relief.pixel  # not on walls
    shore = (around[0, 0] > 0) & ~patch.lies & patch.relief.there & level
    spots = replace(patch, lies=shore).spots(patch.relief)
    lift = growth.thickness * patch.site.size
    color = WETTED * spots.mean(patch.site.setting.colors)
    rim = discs(spots.points + lift * spots.normals, spots.normals, patch.relief, DAMP, color)
    sh = rim.sh.new_zeros(len(rim), k, 3)
    sh[:, :1] = rim.sh
    return replace(rim, sh=sh)


def _plane(patch: Patch) -> Water:
    """The level plane that most of a patch is on, near the middle of the scene."""
    ground, up, pixel = patch.relief.points[patch.lies], patch.site.up, patch.relief.pixel
    height = ground @ up
    near = (ground - patch.site.setting.found.place.center).norm(dim=-1) / patch.site.size
    layer = ((height - height.min()) / (WAVER * pixel)).long()
    votes = (
        torch.zeros(int(layer.max()) + 1).double().index_add_(0, layer, torch.exp(-near.square()))
    )
    level = float(height[layer == int(votes.argmax())].median())
    normal, offset = refined_plane(ground.numpy(), up.numpy(), level, WAVER * pixel)
    plane = Water(torch.from_numpy(normal), float(offset))
    rough = ground @ plane.normal - plane.offset
    rough = rough[rough.abs() < WAVER * pixel]
    return replace(plane, offset=plane.offset + float(rough.quantile(FULL)) + LIFT * pixel)


def _reflecting(
    scene: Gaussians,
    plane: Water,
    points: Float[Tensor, "m 3"],
    bottom: Float[Tensor, "m 3"],
    cameras: Sequence[Camera],
    around: Surroundings,
    execution: Execution,
) -> Float[Tensor, "m k 3"]:
    """SH of water at these points over a bottom of these display colors, which mirrors a scene and,
    where no camera saw any of it, its surroundings."""
    image = gaussians_of(plane.mirror().table(table_of(scene)))
    cameras = [cameras[i].fitted(VIEW_PIXELS) for i in evenly_spaced(len(cameras), VIEWS)]
    shown, ways, weights = [], [], []
    for camera in cameras:
        drawn = render(image, camera, execution=execution)
        picture = torch.cat((drawn.color.clamp(0, 1), drawn.alpha[..., None]), -1)
        xy, depth = camera.project(points)
        size = xy.new_tensor((camera.width, camera.height))
        grid = (2 * xy / size - 1).to(picture)
        sampled = torch.nn.functional.grid_sample(
            picture.movedim(-1, 0)[None],
            grid[None, None],
            padding_mode="border",
            align_corners=False,
        )[0, :, 0].T.double()
        way = torch.nn.functional.normalize(points - camera.center.double(), dim=-1)
        cosine = -(way @ plane.normal)
        away = (way + 2 * cosine[:, None] * plane.normal).float()
        seen = look_up(around.seen[..., None], away).double() * sampled[:, 3:]
        light = look_up(around.radiance, away).double().clamp(0, 1)
        beyond = torch.from_numpy(srgb_of_linear(light.numpy()))
        color = sampled[:, :3] / sampled[:, 3:].clamp_min(1e-3)
        mirrored = torch.lerp(beyond, color, seen)
        share = (HEAD_ON + (1 - HEAD_ON) * (1 - cosine.clamp(0, 1)) ** GRAZING)[:, None]
        shown.append(bottom + share * (mirrored - bottom))
        ways.append(way)
        weights.append(((grid.abs() < 1).all(-1) & (depth > 0) & (cosine > 0)).double())
    return _fitted(torch.stack(shown, 1), torch.stack(ways, 1), torch.stack(weights, 1), bottom)


def _fitted(
    colors: Float[Tensor, "m v 3"],
    ways: Float[Tensor, "m v 3"],
    weights: Float[Tensor, "m v"],
    usual: Float[Tensor, "m 3"],
) -> Float[Tensor, "m k 3"]:
    """SH coefficients with the least weighted squared error; those of a usual color where no camera
    looks."""
    stiff = torch.tensor([STIFF[band] for band in range(DEGREE + 1) for _ in range(2 * band + 1)])
    stiff = stiff.double()
    mean = (weights[..., None] * colors).sum(1) / weights.sum(1, keepdim=True).clamp_min(1e-9)
    mean = torch.where(weights.sum(1, keepdim=True) > 0, mean, usual)
    found = []
    for rows in torch.arange(len(colors)).split(ROWS):
        harmonics = basis(ways[rows].reshape(-1, 3), DEGREE).reshape(len(rows), -1, len(stiff))
        share = weights[rows] / weights[rows].sum(1, keepdim=True).clamp_min(1e-9)
        matrix = harmonics.mT @ (share[..., None] * harmonics) + torch.diag(stiff)
        right = harmonics.mT @ (share[..., None] * (colors[rows] - mean[rows, None]))
        sh = torch.linalg.solve(matrix, right)
        sh[:, 0] += (mean[rows] - 0.5) / basis(ways[:1, 0], 0)[0, 0]
        found.append(sh)
    return torch.cat(found)
