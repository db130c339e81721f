"""Pictures with cameras: photos read from disk, cameras placed by us, and renders of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, radians, sin
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.camera import Camera, look_at
from rasterizer.render import render
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class View:
    """One picture and where it was taken from."""

    name: str
    camera: Camera
    image: Float[Tensor, "h w 3"]
    """sRGB values in [0, 1]; h and w are the camera's."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """Posed pictures of one scene, and the sparse points they came with, if any."""

    views: tuple[View, ...]
    points: Float[Tensor, "n 3"] | None = None
    """World positions, same frame as the cameras."""
    point_colors: Float[Tensor, "n 3"] | None = None
    """In [0, 1]."""
    source: Path | None = None

    def __len__(self) -> int:
        return len(self.views)

    def split(self, every: int = 8) -> tuple[tuple[View, ...], tuple[View, ...]]:
        """(training, held out): every `every`-th view, counted from the first, is held out."""
        held_out = self.views[::every]
        return tuple(v for i, v in enumerate(self.views) if i % every), held_out


@dataclass(frozen=True)
class Bounds:
    """What a scene is about, robust to the far-away splats that every capture has."""

    centre: tuple[float, float, float]
    radius: float


def bounds(points: Float[Tensor, "n 3"], weights: Float[Tensor, " n"] | None = None) -> Bounds:
    """Median centre, and the radius that holds nearly all of it, or the dense middle of a capture.

    With weights, only the heavier half counts. Raises ValueError for no points.
    """
    if not len(points):
        raise ValueError("bounds of no points")
    kept = points.detach().to(torch.float64)
    if weights is not None:
        kept = kept[weights >= weights.median()]
    centre = kept.median(0).values
    distance = (kept - centre).norm(dim=-1).sort().values
    half, most = (float(distance[int(f * (len(distance) - 1))]) for f in (0.5, 0.98))
    # an object alone ends within 2.5 times the median distance; surroundings go on and on
    radius = min(most, 2.5 * half)
    return Bounds((float(centre[0]), float(centre[1]), float(centre[2])), max(radius, 1e-6))


def orbit(
    scene: Gaussians,
    count: int,
    size: int,
    *,
    up: tuple[float, float, float] = (0.0, -1.0, 0.0),
    elevation: float = 20.0,
    fov: float = 50.0,
) -> tuple[Camera, ...]:
    """Cameras on a circle around the scene, `size` pixels square, for a scene without any.

    `up` is a world axis: splat files keep the training frame, in which y usually points down.
    `elevation` and `fov` are in degrees.
    """
    at = bounds(scene.means, scene.opacities)
    target = torch.tensor(at.centre, dtype=torch.float64)
    axis = torch.nn.functional.normalize(torch.tensor(up, dtype=torch.float64), dim=0)
    helper = torch.eye(3, dtype=torch.float64)[int(axis.abs().argmin())]
    east = torch.nn.functional.normalize(torch.linalg.cross(axis, helper), dim=0)
    north = torch.linalg.cross(axis, east)
    distance = 1.05 * at.radius / sin(radians(fov) / 2)  # the sphere of the bounds, with a margin
    rise = radians(elevation)
    cameras = []
    for i in range(count):
        turn = 2 * pi * i / count
        flat = cos(turn) * east + sin(turn) * north
        eye = target + distance * (cos(rise) * flat + sin(rise) * axis)
        cameras.append(look_at(eye, target, axis, fov, size, size))
    return tuple(cameras)


@torch.no_grad()
def capture(scene: Gaussians, cameras: Sequence[Camera], names: Sequence[str]) -> tuple[View, ...]:
    """Pictures of a scene from some cameras, clamped to [0, 1]."""
    return tuple(
        View(name, camera, render(scene, camera).color.clamp(0, 1))
        for name, camera in zip(names, cameras, strict=True)
    )
