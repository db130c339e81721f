"""Cameras of a tab, as viser has them, and cameras of the renderer."""

from __future__ import annotations

from math import atan, tan
from typing import Any

import numpy as np
import torch

from gsedit.app.document import Eye
from rasterizer.camera import Camera

LEAST_PIXELS = 16
"""Smaller canvases, as of a tab that is being opened, count as this."""


def camera_of(
    wxyz: np.ndarray, position: np.ndarray, fov: float, size: tuple[int, int], near: float | None
) -> Camera:
    """The camera of a pose (camera to world, OpenCV axes), with a vertical field of view, radians,
    and a picture of `size` (width, height)."""
    w, x, y, z = (float(each) for each in np.asarray(wxyz) / np.linalg.norm(wxyz))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    width, height = (max(each, LEAST_PIXELS) for each in size)
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.from_numpy(rotation.T.copy())
    pose[:3, 3] = -pose[:3, :3] @ torch.tensor([float(each) for each in position]).double()
    focal = height / 2 / tan(fov / 2)
    return Camera(pose, focal, focal, width / 2, height / 2, width, height, near=near)


def eye_of(camera: Camera, distance: float) -> Eye:
    """The place of a camera that turns about what is `distance` before it."""
    center, forward = camera.center.double(), camera.forward.double()
    up = -camera.rotation[1].double()
    fov = 2 * atan(camera.height / 2 / camera.fy)
    return Eye(point_of(center), point_of(center + distance * forward), point_of(up), fov)


def handle_eye(handle: Any) -> Eye:
    """The place of a viser camera."""
    position, target, up = handle.position, handle.look_at, handle.up_direction
    fov = widened(float(handle.fov), 1 / height_of(handle))
    return Eye(point_of(position), point_of(target), point_of(up), fov)


def widened(fov: float, factor: float) -> float:
    """The field of view, radians, across so many times the length."""
    return 2 * atan(factor * tan(fov / 2))


def height_of(handle: Any) -> float:
    """Height of a viser camera's picture in its shorter sides."""
    return max(handle.image_height / max(handle.image_width, 1), 1.0)


def point_of(values: Any) -> tuple[float, float, float]:
    """Three numbers of a vector."""
    x, y, z = (float(each) for each in values)
    return x, y, z
