"""Visibility of light: shares of it that come past what is in the way, by depth from its side.

`n` points, `d` directions; world units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, radians

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.quaternions import even_directions
from gsedit.views.orbit import parallel, perpendicular
from gsedit.views.place import Place
from rasterizer.camera import Camera, look_at
from rasterizer.render import render
from rasterizer.scene import Gaussians

OFFSET_PIXELS = 1.0
"""Distance above a surface, in pixels of a map, at which light on it is asked for."""

BIAS_PIXELS, BIAS_SIZES = 1.5, 1.0
"""Least depth behind a surface that is in its shadow, in pixels of the map and in median standard
deviations of what casts it: less is the surface itself, whose depth is not known better."""
SMALL_SKY, SHARP = 160, 448
"""Sides of the depth maps of the sky and of suns and lamps, pixels."""
SKY_DIRECTIONS = 48
"""Evenly spread directions of the whole sphere; those above the ground are the sky."""
FAINT_OPACITY, WIDE = 0.3, 0.08
"""Gaussians that cast shadows are more opaque than this, and smaller than this share of the radius:
others are haze."""
SUN_RAYS = 6
"""Directions within a sun's disc: their mean is its soft shadow."""


def open_share(
    occluders: Gaussians,
    place: Place,
    points: Float[Tensor, "n 3"],
    directions: Float[Tensor, "d 3"],
    *,
    normals: Float[Tensor, "n 3"] | None = None,
    side: int = SMALL_SKY,
    reach: float = inf,
) -> Float[Tensor, "n d"]:
    """Share, in [0, 1], of parallel light from each direction that comes to points of a place.

    What is farther than `reach` before a point hides nothing from it. With `normals`, the points
    are of a surface, and light is asked for just above it.
    """
    if normals is not None:
        points = points + OFFSET_PIXELS * 2 * place.radius / side * normals
    maps = (parallel_map(occluders, place, each, side) for each in directions)
    return torch.stack([lit_share(each, points, reach) for each in maps], 1)


def past_body(
    body: Gaussians,
    points: Float[Tensor, "n 3"],
    directions: Float[Tensor, "d 3"],
    normals: Float[Tensor, "n 3"] | None = None,
) -> Float[Tensor, "n d"]:
    """Share, in [0, 1], of each direction's light that comes to points past one object, which the
    points may be of."""
    solid = replace(body, sh=body.sh[:, :1])[body.opacities > FAINT_OPACITY].detach()
    solid = solid if len(solid) else body.detach()
    means = solid.means.double()
    middle = (means.amin(0) + means.amax(0)) / 2
    radius = 1.1 * float((means - middle).norm(dim=-1).amax()) + 1e-9
    up, front = torch.eye(3, dtype=torch.float64)[:2]
    place = Place(middle, up, front, 2 * radius, radius)
    return open_share(solid, place, points, directions, normals=normals)


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


def sky_directions(place: Place, count: int = SKY_DIRECTIONS) -> Float[Tensor, "d 3"]:
    """Evenly spread directions of the sky, unit vectors, float64: of `count` those above ground."""
    every = torch.from_numpy(even_directions(count)).double()
    height = every @ place.up
    return every[height > 0.08]


def sun_directions(direction: Float[Tensor, "3"], blur: float) -> Float[Tensor, "r 3"]:
    """Directions within a disc of `blur` degrees around a unit vector."""
    across = perpendicular(direction)
    along = torch.linalg.cross(direction, across)
    turn = torch.arange(SUN_RAYS, dtype=torch.float64)
    reach = radians(blur) * ((turn + 0.5) / SUN_RAYS).sqrt()
    angle = 2.399963 * turn  # the golden angle
    offset = angle.cos()[:, None] * across + angle.sin()[:, None] * along
    return torch.nn.functional.normalize(direction + reach[:, None] * offset, dim=-1)


def parallel_map(
    occluders: Gaussians, place: Place, direction: Float[Tensor, "3"], side: int
) -> DepthMap:
    """Depth of the place from far away along a unit vector, in parallel rays."""
    pixel, away = 2 * place.radius / side, 2 * place.radius
    camera = parallel(place.center, direction, place.up, pixel, (side, side), away)
    return _drawn(occluders, replace(camera, near=1e-3 * place.radius), pixel)


def spot_map(occluders: Gaussians, place: Place, eye: Float[Tensor, "3"], cone: float) -> DepthMap:
    """Depth of the place from a lamp at `eye` that looks at its center; half a cone in degrees."""
    distance = float((eye - place.center).norm())
    towards = (eye - place.center) / distance
    upward = place.up if abs(float(place.up @ towards)) < 0.99 else perpendicular(towards)
    camera = look_at(eye, place.center, upward, 2 * cone, SHARP, SHARP)
    camera = replace(camera, near=0.15 * distance)
    return _drawn(occluders, camera, distance / camera.fx)


@torch.no_grad()
def _drawn(occluders: Gaussians, camera: Camera, pixel: float) -> DepthMap:
    depth = render(occluders, camera, median_depth=True).median_depth
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
