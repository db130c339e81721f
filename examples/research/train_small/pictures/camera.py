"""The pinhole camera of a picture: where it stands, and the rays of its sub-pixels."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, pi, radians, sin, tan
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import Solid
from research.train_small.pictures.vectors import direction, turned


class Pinhole(NamedTuple):
    """A square picture's camera, in world units."""

    origin: Float[Tensor, "3"]
    axes: Float[Tensor, "3 3"]
    """Right, down and forward, one a row."""
    focal: float
    """Focal length in picture heights."""
    distance: float
    """Distance to the subject's middle, along the view."""

    @property
    def heading(self) -> float:
        """The azimuth of the view, radians."""
        return atan2(float(self.axes[2, 1]), float(self.axes[2, 0]))

    def rays(self, size: int) -> Float[Tensor, "2 m"]:
        """x and y, right and down at unit depth, of the rays of size^2 sub-pixels, row by row."""
        steps = ((torch.arange(size) + 0.5) / size - 0.5) / self.focal
        y, x = torch.meshgrid(steps, steps, indexing="ij")
        return torch.stack((x.flatten(), y.flatten()))

    def directions(self, xy: Float[Tensor, "2 m"]) -> Float[Tensor, "3 m"]:
        """The rays' directions in the world, of unit depth."""
        right, down, forward = self.axes[:, :, None]
        return right * xy[0] + down * xy[1] + forward


def random_camera(rng: RandomStream, subject: Sequence[Solid]) -> Pinhole:
    """A camera that shows the subject, 20 % to 115 % of the picture, off the middle."""
    points = _outline(subject)
    middle = (points.amin(0) + points.amax(0)) / 2
    elevation = radians(rng(-3, 15) if rng.chance(0.45) else rng(10, 50))
    azimuth, fov = rng(0, 2 * pi), radians(rng(25, 65))
    back = torch.tensor(direction(azimuth, elevation))
    right = torch.tensor((-sin(azimuth), cos(azimuth), 0.0))
    up = torch.linalg.cross(back, right)
    offsets = points - middle
    wide, tall = torch.stack((offsets @ right, offsets @ up)).abs().amax(-1)
    focal, extent = 0.5 / tan(fov / 2), 2 * float(torch.maximum(tall, 0.9 * wide))
    fill = rng(0.4, 1.15) if rng.chance(0.8) else rng(0.2, 0.5)
    distance = max(focal * extent / fill, float((offsets @ back).amax()) + 0.25)
    origin = middle + distance * back
    origin[2] = origin[2].clamp_min(0.08)  # above the ground
    roll, shift = rng(-0.06, 0.06), 0.22 * (1.15 - 0.6 * fill)
    tilt = torch.tensor(turned(roll, rng(-shift, shift) / focal, rng(-shift, shift) / focal))
    axes = tilt @ torch.stack((right, -up, -back))
    return Pinhole(origin, axes, focal, max(float((middle - origin) @ axes[2]), 0.2))


def _outline(solids: Sequence[Solid]) -> Float[Tensor, "p 3"]:
    """Six points around the middle of every solid, at 0.7 of its longest half axis."""
    centers = torch.tensor([solid.center for solid in solids], dtype=torch.float64)
    reach = torch.tensor([0.7 * max(solid.half) for solid in solids], dtype=torch.float64)
    axes = torch.eye(3, dtype=torch.float64)
    star = torch.stack((-axes, axes), 1).reshape(-1, 3)
    return (centers[:, None] + reach[:, None, None] * star).reshape(-1, 3).float()
