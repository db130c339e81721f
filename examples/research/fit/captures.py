"""Captures with exact poses: a synthetic scene in a room, photographed as a person walks around it.

The photos have what real ones have: pixels with an area, sensor noise, 8 bits, and sparse points
that are not quite on the surface. Exposure differs from photo to photo only where it is asked for.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.synthetic import ring_cameras
from gsedit.bench.synthetic.gallery import columns, demo_scene
from gsedit.bench.synthetic.paint import checker, mix, parts, plain, tiles, waves
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import Distances, Points, Sdf, Triple, length, union
from gsedit.bench.synthetic.splats import surface_points
from gsedit.formats.pictures import as_picture, save_picture
from gsedit.run.atomic import atomic_path
from gsedit.views.dataset import Dataset, View
from rasterizer.camera import Camera

WALL = 5.0
"""Radius of the round room, world units: cameras stand at about 3."""
FLOOR = -1.0
ELEVATIONS = (8.0, 30.0, 52.0)
"""Degrees above the horizon of the three rings that photos are taken from, in turn."""
NOISE = 0.01
"""Standard deviation of a sensor's noise, of the brightest."""
OFF_SURFACE = 0.004
"""Standard deviation of the points' errors, of the scene's radius."""


def plane(normal: Triple, offset: float) -> Sdf:
    """The half space `normal . x < offset`; `normal` of any length but zero, `offset` along it."""
    size = sum(n * n for n in normal) ** 0.5
    x, y, z = (n / size for n in normal)

    def distance(points: Points) -> Distances:
        return points[..., 0] * x + points[..., 1] * y + points[..., 2] * z - offset

    return distance


def rooms() -> tuple[SyntheticScene, ...]:
    """The demo's bear, and pillars that hide most from any one camera, each in a room."""
    return room(demo_scene()), room(columns())


def room(scene: SyntheticScene) -> SyntheticScene:
    """The scene on a floor within a round wall, both painted: photos have a background."""
    ground = plane((0.0, 0.0, 1.0), FLOOR)
    paper = mix(plain((0.55, 0.6, 0.72)), plain((0.85, 0.8, 0.66)), waves(2.4))
    wall_paint = mix(paper, plain((0.42, 0.3, 0.33)), checker(1.9, sharpness=2.0))
    boards = mix(plain((0.5, 0.42, 0.34)), plain((0.74, 0.68, 0.58)), tiles(0.7, 0.05))
    around = ((ground, boards), (_wall, wall_paint))
    return replace(
        scene,
        name=f"{scene.name} in a room",
        sdf=union(scene.sdf, ground, _wall),
        albedo=parts((scene.sdf, scene.albedo), *around),
        radius=1.02 * WALL,
    )


def _wall(points: Points) -> Float[Tensor, "*b"]:
    """Distance to a ball from inside."""
    return WALL - length(*points.unbind(-1))


def photographed(
    scene: SyntheticScene,
    views: int = 40,
    size: int = 256,
    *,
    points: int = 3000,
    exposures: float = 0.0,
    seed: int = 0,
) -> Dataset:
    """`views` photos of `size`^2 pixels of one of the `rooms`, and about `points` sparse points on
    the subject and as many on the wall.

    `exposures`: standard deviation of the logarithm of each photo's gain, and half of it of each
    channel's (white balance); photos that `Dataset.split` holds out have none, so that they show
    the scene.
    """
    random = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=random).double()

    subject = replace(scene, radius=1.3)  # what the cameras look at
    rings = [ring_cameras(subject, views, size, elevation) for elevation in ELEVATIONS]
    cameras = [rings[i % len(rings)][i] for i in range(views)]
    photos = []
    for i, camera in enumerate(cameras):
        image = scene.trace(camera, 2).image
        gain = (exposures * draw(1) + 0.5 * exposures * draw(3)).exp() if i % 8 else 1.0
        image = (image * gain + NOISE * draw(size, size, 3)).clamp(0, 1)
        photos.append(View(f"{i:03d}", camera, ((255 * image).round() / 255).float()))
    sparse = _sparse_points(scene, cameras, points, random)
    colors = scene.albedo(sparse).float()
    sparse = sparse + OFF_SURFACE * subject.radius * draw(len(sparse), 3)
    return Dataset(tuple(photos), sparse.float(), colors)


def _sparse_points(
    scene: SyntheticScene, cameras: list[Camera], count: int, random: torch.Generator
) -> Float[Tensor, "n 3"]:
    """Points on the subject, on the floor and on the wall that some camera sees."""
    near = surface_points(replace(scene, radius=1.6), count, random)
    directions = torch.randn(4 * count, 3, generator=random, dtype=torch.float64)
    wall = WALL * torch.nn.functional.normalize(directions, dim=-1)
    far = wall[wall[:, 2] > FLOOR][:count]
    points = torch.cat((near, far))
    seen = torch.zeros(len(points), dtype=torch.bool)
    for camera in cameras[:: max(1, len(cameras) // 8)]:
        seen |= scene.visible(points, camera)
    return points[seen]


def write_dataset(data: Dataset, folder: Path) -> None:
    """Photos, poses and points as a nerfstudio folder; transforms.json is there when all is."""
    frames = []
    for view in data.views:
        save_picture(as_picture(view.image), folder / f"{view.name}.png", overwrite=True)
        camera = view.camera
        pose = camera.world_to_camera.double().inverse()
        pose[:, 1:3] *= -1  # nerfstudio's cameras look along -z, their y is up
        lens = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
        size = {"w": camera.width, "h": camera.height}
        where = {"file_path": f"{view.name}.png", "transform_matrix": pose.tolist()}
        frames.append({**where, **lens, **size})
    _write_points(data, folder / "points.ply")
    with atomic_path(folder / "transforms.json", overwrite=True) as temporary:
        record = {"frames": frames, "ply_file_path": "points.ply"}
        temporary.write_text(json.dumps(record), encoding="utf-8")


def _write_points(data: Dataset, path: Path) -> None:
    assert data.points is not None
    assert data.point_colors is not None
    colors = (255 * data.point_colors).round().int().tolist()
    head = ["ply", "format ascii 1.0", f"element vertex {len(colors)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"property uchar {name}" for name in ("red", "green", "blue")] + ["end_header"]
    lines = (" ".join(map(str, (*at, *rgb))) for at, rgb in zip(data.points.tolist(), colors))
    path.write_text("\n".join((*head, *lines)) + "\n", encoding="ascii")
