"""Photos of a small room through a lens with distortion: textured walls, and a textured box in the
middle. Exact rays; the pixels are samples of smooth noise, so that SIFT finds its features."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin
from pathlib import Path

import numpy as np
from PIL import Image

SIZE = 192
ROOM, BOX = 2.6, 0.5  # half sides
TEXTURE = 256  # texels on a side of a wall


@dataclass(frozen=True)
class RealLens:
    """A pinhole with Brown's radial distortion; pixels."""

    width: int = SIZE
    height: int = SIZE
    focal: float = 0.8 * SIZE
    k1: float = -0.12
    k2: float = 0.03

    def rays(self) -> np.ndarray:
        """Directions of unit depth through the pixels' centers, [h, w, 3]."""
        x = (np.arange(self.width) + 0.5 - self.width / 2) / self.focal
        y = (np.arange(self.height) + 0.5 - self.height / 2) / self.focal
        distorted = np.stack(np.meshgrid(x, y), -1)
        ideal = distorted
        for _ in range(30):
            r2 = (ideal**2).sum(-1, keepdims=True)
            ideal = distorted / (1 + self.k1 * r2 + self.k2 * r2**2)
        return np.concatenate((ideal, np.ones_like(ideal[..., :1])), -1)


@dataclass(frozen=True)
class Room:
    """Paint on the walls and on the box."""

    seed: int = 0
    contrast: float = 1.0
    """Factor of the differences; 0: grey everywhere."""
    texture: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        total = np.zeros((12, TEXTURE, TEXTURE, 3), dtype=np.float32)
        for cells, weight in ((8, 0.5), (24, 0.6), (64, 0.6)):
            for face in total:
                noise = random.integers(0, 256, (cells, cells, 3), dtype=np.uint8)
                large = Image.fromarray(noise).resize((TEXTURE, TEXTURE), Image.Resampling.BICUBIC)
                face += weight * (np.asarray(large, dtype=np.float32) - 128)
        object.__setattr__(self, "texture", (128 + self.contrast * total).clip(0, 255))

    def color(self, points: np.ndarray, first: np.ndarray) -> np.ndarray:
        """The texture of a cube's faces (numbers `first` to `first` + 5) at points on it, in the
        cube's half sides."""
        axis = np.abs(points).argmax(-1)
        value = np.take_along_axis(points, axis[..., None], -1)[..., 0]
        uv = np.stack([np.delete(points, i, -1) for i in range(3)])
        uv = np.take_along_axis(uv, axis[None, ..., None], 0)[0]
        at = ((uv + 1) / 2 * (TEXTURE - 1)).clip(0, TEXTURE - 1.001)
        (x, y), (s, t) = np.moveaxis(at.astype(int), -1, 0), np.moveaxis(at % 1, -1, 0)[..., None]
        texels = self.texture
        face = first + 2 * axis + (value > 0)
        upper = texels[face, y, x] * (1 - s) + texels[face, y, x + 1] * s
        lower = texels[face, y + 1, x] * (1 - s) + texels[face, y + 1, x + 1] * s
        return upper * (1 - t) + lower * t

    def photo(self, world_to_camera: np.ndarray, lens: RealLens) -> np.ndarray:
        """Picture of a camera inside the room, uint8 [h, w, 3]."""
        to_world = np.linalg.inv(world_to_camera)
        origin, direction = to_world[:3, 3], lens.rays() @ to_world[:3, :3].T
        with np.errstate(divide="ignore"):
            inverse = 1 / direction
        near, far = ((sign * half * np.sign(inverse) - origin) * inverse
                     for sign, half in ((-1, BOX), (1, BOX)))  # fmt: skip
        enter, leave = near.max(-1), far.min(-1)
        hit = (enter > 0) & (enter < leave)
        wall = ((ROOM * np.sign(inverse) - origin) * inverse).min(-1)
        depth = np.where(hit, enter, wall)
        points = origin + depth[..., None] * direction
        points /= np.where(hit, BOX, ROOM)[..., None]
        return self.color(points, np.where(hit, 0, 6)).round().astype(np.uint8)


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float]) -> np.ndarray:
    """World to camera, OpenCV axes; z is up in the world."""
    forward = np.subtract(target, eye)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack((right, np.cross(forward, right), forward))
    pose[:3, 3] = -pose[:3, :3] @ np.asarray(eye)
    return pose


def walk(count: int, degrees: float = 360.0, start: float = 0.0) -> list[np.ndarray]:
    """Poses around the box, at changing heights, looking at it."""
    angles = [radians(start) + radians(degrees) * i / count for i in range(count)]
    eyes = [(1.8 * cos(a), 1.8 * sin(a), 0.7 + 0.3 * sin(3 * a)) for a in angles]
    return [look_at(eye, (0, 0, -0.2)) for eye in eyes]


def turn(count: int, step: float = 12.0) -> list[np.ndarray]:
    """Poses of a camera that turns on the spot, `step` degrees between photos."""
    eye = (1.8, 0.0, 0.7)
    targets = [(1.8 - cos(radians(step * i)), sin(radians(step * i)), 0.5) for i in range(count)]
    return [look_at(eye, target) for target in targets]


def take(
    folder: Path, poses: list[np.ndarray], lens: RealLens | None = None, room: Room | None = None,
    first: int = 0,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Write a photo a pose; the poses by the stems of the photos' names."""
    folder.mkdir(parents=True, exist_ok=True)
    room, lens = room or Room(), lens or RealLens()
    known = {}
    for i, pose in enumerate(poses):
        name = f"photo_{first + i:02d}"
        Image.fromarray(room.photo(pose, lens)).save(folder / f"{name}.jpg", quality=95)
        known[name] = pose
    return known
