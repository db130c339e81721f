"""Small datasets of posed photos, and what their cameras see."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from bad_files import dataset

from gsedit.views.undistort import Lens
from rasterizer import look_at


def color(rays: torch.Tensor) -> torch.Tensor:
    """A smooth picture as a function of the direction (x / z, y / z): slow waves in [0, 1]."""
    x, y = rays.unbind(-1)
    waves = (torch.sin(3 * x + 1), torch.cos(4 * y - x), torch.sin(2 * x * y + 3 * y))
    return (0.5 + 0.5 * torch.stack(waves, -1)).float()


def rays_of(lens: Lens) -> torch.Tensor:
    """The direction of each pixel center of an ideal lens."""
    centers = lens.camera(torch.eye(4)).pixel_centers()
    focal = torch.tensor([lens.fx, lens.fy], dtype=torch.float64)
    return (centers - torch.tensor([lens.cx, lens.cy], dtype=torch.float64)) / focal


def opengl_camera_to_world(camera) -> list[list[float]]:
    pose = torch.linalg.inv(camera.world_to_camera)
    pose[:3, 1:3] *= -1
    return pose.tolist()


def cameras(count: int = 3):
    for i in range(count):
        eye = torch.tensor([math.cos(2.0 * i), math.sin(2.0 * i), 0.5 + i])
        yield look_at(eye, torch.zeros(3), torch.tensor([0.0, 0, 1]), 50.0, 8, 6)


COLMAP_LENSES = {
    "SIMPLE_PINHOLE": ([9.0, 4, 3], Lens(9.0, 9.0, 4.0, 3.0, 8, 6)),
    "PINHOLE": ([9.0, 10, 4, 3], Lens(9.0, 10.0, 4.0, 3.0, 8, 6)),
    "SIMPLE_RADIAL": ([9.0, 4, 3, 0.1], Lens(9.0, 9.0, 4.0, 3.0, 8, 6).bent(k1=0.1)),
    "RADIAL": ([9.0, 4, 3, 0.1, 0.01], Lens(9.0, 9.0, 4.0, 3.0, 8, 6).bent(k1=0.1, k2=0.01)),
    "OPENCV": (
        [9.0, 10, 4, 3, 0.1, 0.01, 0.001, 0.002],
        Lens(9.0, 10.0, 4.0, 3.0, 8, 6).bent(k1=0.1, k2=0.01, p1=0.001, p2=0.002),
    ),
}


def colmap_dataset(folder: Path, model: str = "PINHOLE", text: bool = False) -> Path:
    """Three photos b0..b2, registered in reverse order, and one point."""
    import pycolmap

    dataset(folder)
    (folder / "transforms.json").unlink()
    params = COLMAP_LENSES[model][0]
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model=model, width=8, height=6, params=params, camera_id=1)
    made.add_camera_with_trivial_rig(camera)
    for i, view in reversed(list(enumerate(cameras()))):
        image = pycolmap.Image(name=f"{i}.png", camera_id=1, image_id=i + 1)
        matrix = view.world_to_camera[:3].numpy()
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(matrix))
    color = np.array([255, 0, 51], np.uint8)
    made.add_point3D(np.array([1.0, 2, 3]), pycolmap.Track(), color)
    (folder / "sparse" / "0").mkdir(parents=True)
    (made.write_text if text else made.write)(folder / "sparse" / "0")
    return folder
