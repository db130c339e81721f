"""Captures of one kind each: a statue in a room, a room, a facade. Blobs on surfaces, cameras."""

from __future__ import annotations

from math import cos, pi, sin

import torch

from rasterizer import Camera, Gaussians, look_at

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
ORIGIN = torch.zeros(3, dtype=torch.float64)
SIZE = 48


def blobs(points: torch.Tensor, radius: float) -> Gaussians:
    """Make an opaque grey ball at each point."""
    n = len(points)
    quats = torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(n, 1)
    log_scales = torch.full((n, 3), radius).log()
    return Gaussians(points.float(), quats, log_scales, torch.full((n,), 4.0), torch.zeros(n, 1, 3))


def sphere(count: int, radius: float) -> torch.Tensor:
    """Points spread evenly on a sphere about the origin."""
    i = torch.arange(count, dtype=torch.float64) + 0.5
    z, angle = 1 - 2 * i / count, i * pi * (3 - 5**0.5)
    ring = (1 - z * z).sqrt()
    return radius * torch.stack((ring * angle.cos(), ring * angle.sin(), z), -1)


def walls(side: int, half: float) -> torch.Tensor:
    """A grid of points on the six faces of a cube about the origin."""
    ticks = torch.linspace(-half, half, side, dtype=torch.float64)
    u, v = (t.reshape(-1) for t in torch.meshgrid(ticks, ticks, indexing="ij"))
    faces = []
    for axis in range(3):
        for end in (-half, half):
            face = torch.full((side * side, 3), end, dtype=torch.float64)
            face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = u, v
            faces.append(face)
    return torch.cat(faces)


def looking(eye: tuple[float, float, float], target: torch.Tensor = ORIGIN, fov: float = 50.0):
    """A camera of SIZE^2 pixels."""
    return look_at(torch.tensor(eye, dtype=torch.float64), target, UP, fov, SIZE, SIZE)


def around(count: int, distance: float, height: float = 0.3) -> list[Camera]:
    """A ring of cameras that look at the origin."""
    turns = [2 * pi * i / count for i in range(count)]
    return [looking((distance * cos(t), distance * sin(t), height)) for t in turns]


def statue() -> tuple[Gaussians, torch.Tensor]:
    """A ball in a room, and the flags of its Gaussians."""
    ball, room = sphere(300, 0.5), walls(12, 2.5)
    scene = blobs(torch.cat((ball, room)), 0.07)
    scene.log_scales[len(ball) :] = torch.tensor(0.25).log()
    return scene, torch.arange(len(scene)) < len(ball)


def statue_with_close_ups() -> tuple[Gaussians, list[Camera], list[int]]:
    """Twenty-four whole views from all around and sixteen close-ups; the indices of these."""
    scene, _ = statue()
    near = [looking((0.75 * cos(t), 0.75 * sin(t), 0.2)) for t in range(12)]
    off = torch.tensor([2.5, 0.3, 0.4], dtype=torch.float64)  # a piece of wall beside the statue
    wallpaper = [looking((1.7, 0.1 * i, 0.3), off) for i in range(4)]
    cameras = around(24, 1.6) + near + wallpaper
    return scene, cameras, list(range(24, len(cameras)))


def room() -> tuple[Gaussians, list[Camera]]:
    """A cube from inside: cameras stand near its middle and look outwards, some near a wall."""
    scene = blobs(walls(16, 2.0), 0.18)
    cameras = []
    for i in range(24):
        turn = 2 * pi * i / 24
        ahead = torch.tensor([2 * cos(turn), 2 * sin(turn), 0.0], dtype=torch.float64)
        cameras.append(looking((-0.4 * cos(turn), -0.4 * sin(turn), 0.1), ahead, 70.0))
    for i in range(8):
        ahead = torch.tensor([2.0, 0.2 * i - 0.7, 0.0], dtype=torch.float64)
        cameras.append(looking((1.5, 0.2 * i - 0.7, 0.1), ahead))
    return scene, cameras


def facade() -> tuple[Gaussians, list[Camera]]:
    """A wall with a relief, from the front: twenty cameras side by side with parallel views."""
    ticks = torch.linspace(-1.5, 1.5, 24, dtype=torch.float64)
    x, z = (t.reshape(-1) for t in torch.meshgrid(ticks, ticks, indexing="ij"))
    relief = 0.2 * (3 * x).sin() * (2 * z).cos()
    scene = blobs(torch.stack((x, relief, z), -1), 0.08)
    cameras = []
    for row in range(4):
        for column in range(5):
            dx, dz = 0.2 * (column - 2), 0.2 * (row - 1.5)
            target = torch.tensor([dx, 0.0, dz], dtype=torch.float64)
            cameras.append(looking((dx, -2.5, dz), target))
    return scene, cameras
