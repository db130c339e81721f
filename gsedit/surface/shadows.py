"""Shadows from depth that is rendered from the light's side. `n` points; world units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.cameras.place import Place
from gsedit.scene.quaternions import even_directions
from rasterizer.camera import Camera, look_at
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians

BIAS_PIXELS, BIAS_SIZES = 1.5, 1.0
"""Least depth behind a surface that is in its shadow, in pixels of the map and in median standard
deviations of what casts it: less is the surface itself, whose depth is not known better."""
SMALL_SKY, SHARP = 160, 448
"""Sides of the depth maps of the sky and of suns and lamps, pixels."""
SKY_DIRECTIONS = 48
"""Evenly spread directions of the whole sphere; those above the ground are the sky."""
LOWEST_SKY = 0.08
"""Least height of a direction of the sky, as the sine of its elevation."""
FAINT_OPACITY, WIDE = 0.3, 0.08
"""Gaussians that cast shadows are more opaque than this, and smaller than this share of the radius:
others are haze."""
SUN_RAYS = 6
"""Directions within a sun's disc: their mean is its soft shadow."""
GOLDEN_ANGLE = 2.399963


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth of a scene from a light's side."""

    camera: Camera
    depth: Float[Tensor, "h w"]
    """Median depth, world units; infinite where nothing is."""
    bias: float
    """Least depth behind a surface, world units, that is in its shadow."""


def casters(scene: Gaussians, place: Place) -> Gaussians:
    """The Gaussians that cast shadows: opaque, small and near."""
    away = (scene.means.detach().double() - place.center).norm(dim=-1)
    small = scene.scales.amax(-1) < WIDE * place.radius
    inside = (away < place.radius) & small & (scene.opacities > FAINT_OPACITY)
    return replace(scene, sh=scene.sh[:, :1])[inside].detach()


def sky_directions(place: Place) -> Float[Tensor, "d 3"]:
    """Evenly spread directions of the sky, unit vectors, float64."""
    every = torch.from_numpy(even_directions(SKY_DIRECTIONS)).double()
    height = every @ place.up
    return every[height > LOWEST_SKY]


def sun_directions(direction: Float[Tensor, "3"], blur: float) -> Float[Tensor, "r 3"]:
    """Directions within a disc of `blur` degrees around a unit vector."""
    across = perpendicular(direction)
    along = torch.linalg.cross(direction, across)
    turn = torch.arange(SUN_RAYS, dtype=torch.float64)
    reach = radians(blur) * ((turn + 0.5) / SUN_RAYS).sqrt()
    angle = GOLDEN_ANGLE * turn
    offset = angle.cos()[:, None] * across + angle.sin()[:, None] * along
    return torch.nn.functional.normalize(direction + reach[:, None] * offset, dim=-1)


def parallel_map(
    occluders: Gaussians,
    place: Place,
    direction: Float[Tensor, "3"],
    side: int,
    execution: Execution = AUTO,
) -> DepthMap:
    """Depth of the place from far away along a unit vector, in parallel rays."""
    eye = place.center + 2 * place.radius * direction
    camera = look_at(eye, place.center, _level(place.up, direction), 60.0, side, side)
    focal = side / (2 * place.radius)
    camera = replace(camera, fx=focal, fy=focal, model="ortho", near=1e-3 * place.radius)
    return _drawn(occluders, camera, 1 / focal, execution)


def spot_map(
    occluders: Gaussians,
    place: Place,
    eye: Float[Tensor, "3"],
    cone: float,
    execution: Execution = AUTO,
) -> DepthMap:
    """Depth of the place from a lamp at `eye` that looks at its center; half a cone in degrees."""
    distance = float((eye - place.center).norm())
    upward = _level(place.up, (eye - place.center) / distance)
    camera = look_at(eye, place.center, upward, 2 * cone, SHARP, SHARP)
    camera = replace(camera, near=0.15 * distance)
    return _drawn(occluders, camera, distance / camera.fx, execution)


def _level(up: Float[Tensor, "3"], direction: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    return up if abs(float(up @ direction)) < 0.99 else perpendicular(direction)


@torch.no_grad()
def _drawn(occluders: Gaussians, camera: Camera, pixel: float, execution: Execution) -> DepthMap:
    depth = render(occluders, camera, median_depth=True, execution=execution).median_depth
    assert depth is not None
    size = float(occluders.scales.amax(-1).median()) if len(occluders) else 0.0
    bias = BIAS_PIXELS * pixel + BIAS_SIZES * size
    return DepthMap(camera, depth.masked_fill(depth <= 0, torch.inf), bias)


def lit_share(light: DepthMap, points: Float[Tensor, "n 3"], reach: float) -> Float[Tensor, " n"]:
    """Share of the light, in [0, 1], that comes to points past what is at most `reach` before them.

    Points out of the map's picture are lit. Bilinear over the four nearest pixels, and soft in
    depth.
    """
    xy, z = light.camera.project(points)
    x, y = (xy - 0.5).unbind(-1)
    left, top = x.floor(), y.floor()
    bias = light.bias
    height, width = light.depth.shape
    total = torch.zeros_like(z)
    for dx in (0, 1):
        for dy in (0, 1):
            column, row = (left + dx).long(), (top + dy).long()
            inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
            at = light.depth[row.clamp(0, height - 1), column.clamp(0, width - 1)]
            behind = z - at.to(z)
            dark = ((behind - bias) / bias).clamp(0, 1) * (behind < reach) * inside
            weight = (1 - (x - left - dx).abs()) * (1 - (y - top - dy).abs())
            total += weight * (1 - dark)
    return total.masked_fill(z <= 0, 1.0)
