"""Errors of meshes against exact surfaces: `python -m research.measure_meshes`.

Two synthetic objects before one color, as exact discs and fitted to 36 traced photos of 256x256
pixels. Distances in percent of the scene's diameter, both ways; normals against the exact ones
in degrees.
Six minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from gsedit import FitSettings, fit, load
from gsedit.meshing import Mesh, mesh
from gsedit.meshing.triangles import to_open3d
from gsedit.pictures.viewer.libraries import import_open3d
from gsedit.synthetic import (
    SyntheticScene,
    demo_scene,
    ring_cameras,
    scenes,
    surface_gaussians,
    surface_points,
    traced_dataset,
)
from gsedit.synthetic.shapes import gradient
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians
from research.command import print_result, run

SAMPLES = 50_000
RINGS = ((15.0, 16, -90.0), (45.0, 12, -80.0), (-15.0, 8, -70.0))
"""Elevation, number and first azimuth of the views."""


def ring_views(scene: SyntheticScene) -> list[Camera]:
    """36 views of 256x256 pixels around a scene, from above and from below."""
    return [
        camera
        for elevation, count, start in RINGS
        for camera in ring_cameras(scene, count, 256, elevation=elevation, start=start)
    ]


def errors(found: Mesh, scene: SyntheticScene, seen: Tensor) -> tuple[float, float, float]:
    """(Chamfer distance, 95th percentile of the mesh's distances from the surface, both in percent
    of the diameter, mean error of the normals in degrees); `seen` are points of the surface."""
    open3d = import_open3d()
    triangles = to_open3d(found)
    triangles.compute_triangle_normals()
    open3d.utility.random.seed(0)
    cloud = triangles.sample_points_uniformly(SAMPLES, use_triangle_normal=True)
    points = torch.from_numpy(np.asarray(cloud.points))
    away = scene.sdf(points).abs()
    exact = torch.nn.functional.normalize(gradient(scene.sdf, points), dim=-1)
    cosines = (exact * torch.from_numpy(np.asarray(cloud.normals))).sum(-1).clamp(-1, 1)
    rays = open3d.t.geometry.RaycastingScene()
    rays.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(triangles))
    back = rays.compute_distance(open3d.core.Tensor(seen.float().numpy())).numpy()
    percent = 100 / (2 * scene.radius)
    chamfer = (float(away.mean()) + float(back.mean())) / 2 * percent
    angle = float(torch.rad2deg(cosines.acos()).mean())
    return chamfer, float(away.quantile(0.95)) * percent, angle


def seen_points(scene: SyntheticScene, cameras: Sequence[Camera]) -> Tensor:
    """Points of the exact surface that a camera sees."""
    points = surface_points(scene, 8000, torch.Generator().manual_seed(1))
    normals = torch.nn.functional.normalize(gradient(scene.sdf, points), dim=-1)
    raised = points + 1e-4 * normals
    return points[torch.stack([scene.visible(raised, c) for c in cameras[::4]]).any(0)]


def rows(name: str, splats: Gaussians, scene: SyntheticScene, cameras: list[Camera]) -> list[str]:
    """Lines of the table for one scene of splats: open and watertight."""
    seen, lines = seen_points(scene, cameras), []
    for faces, watertight in ((200_000, False), (200_000, True)):
        start = process_time()
        found = mesh(splats, cameras, faces=faces, watertight=watertight)
        spent = process_time() - start
        chamfer, far, angle = errors(found, scene, seen)
        lines.append(
            f"| {name} | {len(found.faces):,} | {'closed' if found.is_closed else 'open'} "
            f"| {chamfer:.2f} | {far:.2f} | {angle:.1f} | {spent:.0f} |"
        )
    return lines


def main(
    name: Annotated[str, typer.Argument(help="One scene alone.")] = "",
    fitted: Annotated[
        Path | None, typer.Argument(help="A scene that was fitted to it before, alone.")
    ] = None,
) -> None:
    """Print the table of the page about meshes."""
    torch.set_num_threads(1)
    print_result("| scene | triangles | | Chamfer, % | 95th percentile, % | normals, degrees | s |")
    print_result("|---|---|---|---|---|---|---|")
    for scene in (scenes()[1], demo_scene()):
        if name not in ("", scene.name):
            continue
        cameras = ring_views(scene)
        if fitted is not None:
            for line in rows(f"{scene.name}, fitted", load(fitted).detach(), scene, cameras):
                print_result(line)
            continue
        discs = surface_gaussians(scene, 12_000, torch.Generator().manual_seed(0))
        settings = FitSettings(steps=1500, max_gaussians=30_000)
        made = fit(traced_dataset(scene, cameras), settings).scene.detach()
        for kind, splats in (("discs", discs), ("fitted", made)):
            for line in rows(f"{scene.name}, {kind}", splats, scene, cameras):
                print_result(line)


if __name__ == "__main__":
    run(main)
