"""Scenes to render: those of the sweep by name, scene files, clouds of any size."""

from __future__ import annotations

from collections.abc import Sequence
from math import tan
from pathlib import Path

import torch

from gsedit.bench.renderer.speed import Workload, garden, smaller, synthetic
from gsedit.cameras.orbit import orbit
from gsedit.errors import UsageError
from gsedit.formats.scenes import read_scene
from rasterizer import Camera, Gaussians


def standard_workloads(
    scenes: Sequence[Path], points: Path | None, *, quick: bool = False
) -> list[Workload]:
    """The garden at two sizes where its points are given, scene files, and synthetic scenes.

    `quick`: every 8th Gaussian and pixel. Raises InputError for a file that cannot be read,
    UsageError where nothing is left to measure.
    """
    files = [fitted(path) for path in dict.fromkeys(scenes)]
    gardens = [] if points is None else [garden(scale, points) for scale in (0.25, 1.0)]
    workloads = [*gardens, *files, *synthetic()]
    if not workloads:
        raise UsageError("nothing to measure: name a scene file")
    return [smaller(one, 8) for one in workloads] if quick else workloads


def fitted(path: Path, size: int = 512) -> Workload:
    """A scene file and the first camera of an orbit around it, `size` pixels square.

    Raises InputError where it cannot be read, UsageError where there is nothing in it.
    """
    scene = read_scene(path).scene.to(torch.float32)
    if not len(scene):
        raise UsageError(f"{path} has no Gaussians: there is nothing to measure")
    return Workload(path.name.split(".")[0], scene, orbit(scene, 1, size)[0])


def cloud(count: int, width: int, height: int, seed: int = 0) -> Workload:
    """Random Gaussians all over a picture, each 1 to 3 pixels in standard deviation, SH degree 0.

    With the same number of pixels a Gaussian, the work a Gaussian is the same at every size.
    """
    generator = torch.Generator().manual_seed(seed)

    def uniform(columns: int, low: float, high: float) -> torch.Tensor:
        return low + (high - low) * torch.rand(count, columns, generator=generator)

    focal = height / 2 / tan(0.5)
    depth = uniform(1, 2.0, 6.0)
    across = uniform(2, -0.5, 0.5) * torch.tensor((width / focal, height / focal)) * depth
    scene = Gaussians(
        means=torch.cat((across, depth), 1),
        quats=torch.randn(count, 4, generator=generator),
        log_scales=(uniform(3, 1.0, 3.0) * depth / focal).log(),
        logit_opacities=torch.logit(uniform(1, 0.05, 0.95)[:, 0]),
        sh=uniform(3, -1.5, 1.5)[:, None],
    )
    pose = torch.eye(4, dtype=torch.float64)
    camera = Camera(pose, focal, focal, width / 2, height / 2, width, height)
    return Workload(f"cloud of {count:,}", scene, camera)
