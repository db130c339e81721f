"""What is drawn: the garden, fitted scenes, synthetic scenes, clouds of any size.

`n` Gaussians, float32, and one camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import tan
from pathlib import Path

import numpy as np
import torch

from gsedit.errors import InputError, UsageError
from gsedit.files import read_scene
from gsedit.synthetic import ring_cameras, scenes, surface_gaussians
from gsedit.views.orbit import orbit
from rasterizer import Camera, Gaussians
from rasterizer.numerics import SH_DC

SYNTHETIC = ("columns", "cage")
"""Synthetic scenes that are measured: one hides most of itself, one has bars a few pixels wide."""


@dataclass(frozen=True, eq=False)
class Workload:
    """A scene and the camera that it is drawn from."""

    name: str
    scene: Gaussians
    camera: Camera


def garden(scale: float, path: Path, view: int = 0) -> Workload:
    """111,785 Gaussians and a camera of 648x420 pixels times `scale`; `view` is 0, 1 or 2.

    The points of mip-NeRF 360's garden (gsplat's test asset: means3d, colors, Ks, viewmats, width,
    height) inside [-2, 2]^3 keep their colours; scales, rotations and opacities are drawn, in this
    order, from NumPy's default_rng(0). Raises InputError where the file is not that.
    """
    try:
        with np.load(path) as file:
            data = {name: file[name] for name in file.files}
        inside = (np.abs(data["means3d"]) <= 2).all(1)
        means, colors = data["means3d"][inside], data["colors"][inside]
        k, pose = data["Ks"][view], torch.from_numpy(data["viewmats"][view]).double()
        width, height = int(data["width"]), int(data["height"])
    except (OSError, ValueError, KeyError, IndexError, EOFError) as error:
        raise InputError(
            f"{path}: not the garden's points ({error}); give gsplat's garden.npz, with means3d, "
            "colors, Ks, viewmats, width and height"
        ) from error
    count = len(means)
    rng = np.random.default_rng(0)
    scales = rng.random((count, 3)) * (0.02 - 1e-4) + 1e-4
    quats = rng.standard_normal((count, 4))
    opacities = rng.random(count)
    scene = Gaussians(
        means=torch.from_numpy(means),
        quats=torch.from_numpy(quats / np.linalg.norm(quats, axis=1, keepdims=True)),
        log_scales=torch.from_numpy(scales).log(),
        logit_opacities=torch.logit(torch.from_numpy(opacities)),
        sh=torch.from_numpy((colors / 255 - 0.5) / SH_DC)[:, None],
    )
    fx, fy, cx, cy = (float(k[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    camera = Camera(pose, fx, fy, cx, cy, width, height)
    camera = camera.resized(round(width * scale), round(height * scale))
    name = f"garden x{scale:g}" + (f", view {view}" if view else "")
    return Workload(name, scene.to(torch.float32), camera)


def fitted(path: Path, size: int = 512) -> Workload:
    """A scene file and the first camera of an orbit around it, `size` pixels square.

    Raises InputError where it cannot be read, UsageError where there is nothing in it.
    """
    scene = read_scene(path).scene.to(torch.float32)
    if not len(scene):
        raise UsageError(f"{path} has no Gaussians: there is nothing to measure")
    return Workload(path.name.split(".")[0], scene, orbit(scene, 1, size)[0])


def synthetic(
    names: tuple[str, ...] = SYNTHETIC, count: int = 30_000, size: int = 256
) -> list[Workload]:
    """Discs on the surfaces of synthetic scenes."""
    chosen = [scene for scene in scenes() if scene.name in names]
    return [
        Workload(
            scene.name,
            surface_gaussians(scene, count, torch.Generator().manual_seed(0)),
            ring_cameras(scene, 1, size)[0],
        )
        for scene in chosen
    ]


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


def smaller(workload: Workload, factor: int) -> Workload:
    """The same view with every `factor`-th Gaussian and pixel, for a quick run."""
    camera = workload.camera
    return replace(
        workload,
        name=f"{workload.name}, 1 in {factor}",
        scene=workload.scene[::factor],
        camera=camera.resized(max(1, camera.width // factor), max(1, camera.height // factor)),
    )


def standard_workloads(
    scenes: Sequence[Path], points: Path | None, *, quick: bool = False
) -> list[Workload]:
    """The garden at two sizes where its points are given, scene files, and synthetic scenes.

    A measurement is identified by its scene's name, so files of one name get their paths as names.
    `quick`: every 8th Gaussian and pixel. Raises InputError for a file that cannot be read,
    UsageError where nothing is left to measure.
    """
    paths = list(dict.fromkeys(scenes))
    files = [fitted(path) for path in paths]
    names = [one.name for one in files]
    files = [
        replace(one, name=str(path)) if names.count(one.name) > 1 else one
        for one, path in zip(files, paths)
    ]
    gardens = [] if points is None else [garden(scale, points) for scale in (0.25, 1.0)]
    workloads = [*gardens, *files, *synthetic()]
    if not workloads:
        raise UsageError("nothing to measure: name a scene file")
    return [smaller(one, 8) for one in workloads] if quick else workloads
