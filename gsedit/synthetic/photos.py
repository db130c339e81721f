"""Pictures of a synthetic scene: cameras around it, and a dataset of exact photos."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from gsedit.synthetic.scene import SyntheticScene
from gsedit.synthetic.splats import surface_points
from gsedit.views.dataset import Dataset, View
from gsedit.views.orbit import circle, perpendicular
from rasterizer.camera import Camera


def ring_cameras(
    scene: SyntheticScene,
    count: int,
    size: int,
    elevation: float = 20.0,
    fov: float = 45.0,
    start: float = -90.0,
) -> tuple[Camera, ...]:
    """`count` cameras of `size`^2 pixels around the scene, at one height, looking at its centre,
    as near as shows the scene's whole ball.

    Angles in degrees: `elevation` above the horizon, `fov` of the picture, `start` the azimuth of
    the first camera (-90: the -y axis, before the demo's bear); the rest follow counter-clockwise.
    """
    centre, up = torch.zeros(3, dtype=torch.float64), scene.up.to(torch.float64)
    east = torch.linalg.cross(perpendicular(up), up)  # the x axis where up is z
    return circle(
        centre, scene.radius, up, count, size, elevation=elevation, fov=fov, start=start, east=east
    )


def traced_dataset(
    scene: SyntheticScene,
    cameras: Sequence[Camera],
    supersample: int = 2,
    points: int = 4000,
    seed: int = 0,
) -> Dataset:
    """Traced photos, float32, and sparse surface points with their colours: a perfect capture."""
    views = tuple(
        View(f"{scene.name}_{i:03d}", camera, scene.trace(camera, supersample).image.float())
        for i, camera in enumerate(cameras)
    )
    sparse = surface_points(scene, points, torch.Generator().manual_seed(seed))
    return Dataset(views, sparse.float(), scene.albedo(sparse).float())
