"""A small scene with labels: a ball, a box with a block on it, and a ball that touches it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from gsedit.bench.synthetic.paint import checker, mix, parts, plain
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import box, cylinder, sphere, translate, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.views.orbit import circle
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

GRASS = mix(plain((0.42, 0.5, 0.3)), plain((0.5, 0.58, 0.36)), checker(0.4))
SOLIDS = (
    ("ground", translate(cylinder(1.5, 0.06), (0, 0, -0.56)), GRASS),
    ("red ball", sphere(0.3, (-0.65, -0.1, -0.21)), plain((0.8, 0.15, 0.12))),
    ("white box", translate(box((0.3, 0.3, 0.2)), (0.45, 0.3, -0.3)), plain((0.85, 0.85, 0.82))),
    ("blue block", translate(box((0.1, 0.1, 0.15)), (0.45, 0.3, 0.05)), plain((0.12, 0.25, 0.7))),
    ("yellow ball", sphere(0.2, (-0.15, -0.1, -0.31)), plain((0.9, 0.75, 0.1))),
)


@dataclass(frozen=True, eq=False)
class Playroom:
    """Gaussians, cameras around them, and the object that each is of."""

    scene: Gaussians
    cameras: tuple[Camera, ...]
    labels: Tensor

    def of(self, name: str) -> Tensor:
        """Flag the Gaussians of an object."""
        return self.labels == [each for each, _, _ in SOLIDS].index(name)


@lru_cache(1)
def playroom(count: int = 7000, size: int = 96) -> Playroom:
    """The scene, with `count` Gaussians and eight pictures of `size` pixels."""
    solids = [solid for _, solid, _ in SOLIDS]
    up = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
    sky = torch.tensor((0.7, 0.8, 0.9), dtype=torch.float64)
    paint = parts(*((solid, coat) for _, solid, coat in SOLIDS))
    whole = SyntheticScene("playroom", union(*solids), paint, sky, 1.7, up)
    scene = surface_gaussians(whole, count, torch.Generator().manual_seed(0))
    distance = torch.stack([solid(scene.means.double()) for solid in solids])
    middle = torch.tensor((0.0, 0.0, -0.2), dtype=torch.float64)
    east = torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)
    cameras = circle(middle, 1.1, up, 8, size, elevation=28.0, fov=45.0, start=-90.0, east=east)
    return Playroom(scene, cameras, distance.argmin(0))
