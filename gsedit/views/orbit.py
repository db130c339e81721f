"""Cameras on a circle around a ball or a scene, and vectors across a direction."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin, tau

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.framing import bounds, guess_up
from rasterizer.camera import Camera, look_at
from rasterizer.scene import Gaussians

Vector = Float[Tensor, "3"]

ELEVATION = 20.0
"""Degrees above the horizon of views around an object."""


def perpendicular(vectors: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """A unit vector across each (which must not be zero): its cross product with the coordinate
    axis that it leans on least; the first of equal ones."""
    axis = torch.nn.functional.one_hot(vectors.abs().argmin(-1), 3).to(vectors)
    return torch.nn.functional.normalize(torch.linalg.cross(vectors, axis), dim=-1)


def unit_up(up: Vector) -> Vector:
    """The upward unit vector, float64. Raises UsageError for what is no direction."""
    if not up.isfinite().all() or not up.any():
        raise UsageError(f"up {up.tolist()} is no direction: three finite numbers, not all 0")
    return torch.nn.functional.normalize(up.detach().double(), dim=0)


def parallel(
    middle: Vector, axis: Vector, up: Vector, pixel: float, size: tuple[int, int], away: float
) -> Camera:
    """A camera in parallel rays that looks at a middle against a unit vector, `away` before it.

    Pixels have the side `pixel`, world units; `size` is width and height. A picture against `up`
    has any direction upward.
    """
    upward = up if abs(float(up @ axis)) < 0.99 else perpendicular(axis)
    camera = look_at(middle + away * axis, middle, upward, 60.0, *size)
    return replace(camera, fx=1 / pixel, fy=1 / pixel, model="ortho", near=1e-3 * away)


def towards(up: Vector, east: Vector, azimuth: float, elevation: float) -> Vector:
    """The unit vector at an azimuth (counter-clockwise from `east`, seen from above) and an
    elevation, radians. `up` and `east` are unit vectors, across each other."""
    level = cos(azimuth) * east + sin(azimuth) * torch.linalg.cross(up, east)
    return cos(elevation) * level + sin(elevation) * up


def circle(
    center: Vector,
    radius: float,
    up: Vector,
    count: int,
    size: int,
    *,
    elevation: float,
    fov: float,
    start: float = 0.0,
    east: Vector | None = None,
) -> tuple[Camera, ...]:
    """`count` cameras of `size`^2 pixels at one height around a ball, whose outline touches the
    upper and lower border of each picture.

    `up` is a unit vector, float64. Degrees: `elevation` above the horizon, the picture's `fov`, and
    `start`, the azimuth of the first camera; the rest follow counter-clockwise, seen from above.
    Azimuth 0 is in the direction `east`, a unit vector across `up`: `perpendicular(up)` if None.
    """
    east = perpendicular(up) if east is None else east
    distance = radius / sin(radians(fov) / 2)
    azimuths = (radians(start) + tau * i / count for i in range(count))
    eyes = (center + distance * towards(up, east, each, radians(elevation)) for each in azimuths)
    return tuple(look_at(eye, center, up, fov, size, size) for eye in eyes)


def orbit(
    scene: Gaussians,
    count: int,
    size: int,
    *,
    up: Vector | None = None,
    elevation: float = ELEVATION,
    fov: float = 50.0,
    alone: bool = False,
) -> tuple[Camera, ...]:
    """`count` cameras on a circle around the bulk of a scene, `size`^2 pixels each; around all of
    an object that is known to be `alone`.

    `up` (any length, world axes) is guessed if None; `elevation` and `fov` are in degrees. Raises
    UsageError for an `up` that is no direction, or an empty scene.
    """
    ball = bounds(scene, alone=alone)
    center = torch.tensor(ball.center, dtype=torch.float64)
    axis = unit_up(guess_up(scene) if up is None else up)
    cameras = circle(center, ball.radius, axis, count, size, elevation=elevation, fov=fov)
    return tuple(replace(camera, near=ball.near) for camera in cameras)
