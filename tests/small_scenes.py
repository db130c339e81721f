"""Five synthetic scenes, each with its own difficulty, and captures of synthetic scenes."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import torch

from gsedit.bench.synthetic.gallery import LIGHT, columns, one_scene, painted_scene
from gsedit.bench.synthetic.paint import checker, lit, mix, plain, stripes, waves
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import (
    box,
    capsule,
    cylinder,
    rotate,
    smooth_union,
    sphere,
    torus,
    translate,
    union,
)
from gsedit.bench.synthetic.splats import surface_points
from gsedit.views.dataset import Dataset, View
from rasterizer.camera import Camera


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def scenes() -> tuple[SyntheticScene, ...]:
    """Five small scenes, z up, each within a ball of radius 1 to 1.5."""
    return globe(), links(), columns(), cage(), pond()


def globe() -> SyntheticScene:
    """One sphere, unlit: depth, normals and correspondences have closed forms."""
    marble = mix(plain((0.15, 0.3, 0.6)), plain((0.9, 0.85, 0.6)), waves(0.9))
    paint = mix(marble, plain((0.75, 0.25, 0.2)), checker(0.8, sharpness=2.0))
    return one_scene("globe", sphere(1.0), paint, background=(0.9, 0.9, 0.9), radius=1.1)


def links() -> SyntheticScene:
    """Three interlocked rings: silhouettes everywhere, holes to look through."""
    ring = torus(0.55, 0.17)
    rings = (
        translate(rotate(ring, (1, 0, 0), 20.0), (-0.55, 0, 0)),
        rotate(ring, (1, 0, 0), 95.0),
        translate(rotate(ring, (1, 0, 0), -15.0), (0.55, 0, 0)),
    )
    coats = (
        mix(plain((0.85, 0.3, 0.25)), plain((0.95, 0.8, 0.6)), stripes((0.6, 0.8, 0), 0.3)),
        mix(plain((0.2, 0.5, 0.35)), plain((0.75, 0.9, 0.5)), waves(0.5)),
        mix(plain((0.2, 0.3, 0.7)), plain((0.6, 0.85, 0.95)), checker(0.4, sharpness=2.0)),
    )
    return painted_scene("links", zip(rings, coats), background=(0.95, 0.93, 0.88), radius=1.3)


def cage() -> SyntheticScene:
    """Bars a few pixels wide in front of a rounded box: thin parts, small depth steps."""
    angles = [2 * pi * i / 10 for i in range(10)]
    feet = [(0.75 * cos(a), 0.75 * sin(a)) for a in angles]
    bars = union(*(capsule((x, y, -0.6), (0.5 * x, 0.5 * y, 0.7), 0.035) for x, y in feet))
    hoops = union(
        translate(torus(0.75, 0.045), (0, 0, -0.6)), translate(torus(0.375, 0.045), (0, 0, 0.7))
    )
    block = rotate(box((0.3, 0.3, 0.3), rounding=0.08), (1, 1, 0.3), 40.0)
    painted = (
        (bars, mix(plain((0.85, 0.65, 0.2)), plain((0.55, 0.3, 0.15)), stripes((0, 0, 1), 0.25))),
        (hoops, mix(plain((0.3, 0.3, 0.4)), plain((0.6, 0.6, 0.75)), waves(0.4))),
        (block, mix(plain((0.8, 0.2, 0.4)), plain((0.95, 0.9, 0.85)), checker(0.35))),
    )
    return painted_scene("cage", painted, background=(0.15, 0.18, 0.22), radius=1.05)


def pond() -> SyntheticScene:
    """Smooth mounds on a wide ground: grazing views, a horizon, no sharp silhouette inside."""
    ground = translate(cylinder(1.3, 0.08, rounding=0.06), (0, 0, -0.35))
    hills = smooth_union(
        0.35,
        ground,
        sphere(0.38, (-0.4, 0.15, -0.1)),
        sphere(0.3, (0.35, -0.3, -0.05)),
        capsule((0.1, 0.5, -0.2), (0.65, 0.35, 0.1), 0.16),
    )
    grass = mix(plain((0.35, 0.55, 0.25)), plain((0.75, 0.75, 0.4)), waves(0.7))
    paint = mix(grass, plain((0.55, 0.3, 0.25)), stripes((0.48, 0.36, 0.8), 0.3))
    return one_scene(
        "pond", hills, lit(paint, hills, LIGHT), background=(0.8, 0.88, 0.95), radius=1.4
    )


def traced_dataset(
    scene: SyntheticScene,
    cameras: Sequence[Camera],
    supersample: int = 2,
    points: int = 4000,
    seed: int = 0,
) -> Dataset:
    """Traced photos, float32, and sparse surface points with their colors: a perfect capture."""
    views = tuple(
        View(f"{scene.name}_{i:03d}", camera, scene.trace(camera, supersample).image.float())
        for i, camera in enumerate(cameras)
    )
    sparse = surface_points(scene, points, torch.Generator().manual_seed(seed))
    return Dataset(views, sparse.float(), scene.albedo(sparse).float())
