"""Scenes as the point clouds of Open3D, pyvista and trimesh. `n` Gaussians, `k` SH coefficients."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.formats.pictures import eight_bits
from gsedit.pictures.viewer.libraries import import_open3d, import_pyvista
from gsedit.run.environment import load_package
from gsedit.scene.table import SplatTable, gaussians_of
from rasterizer.numerics import sh_to_color
from rasterizer.scene import Gaussians


def splat_colors(scene: Gaussians) -> Float[Tensor, "n 3"]:
    """The color of every Gaussian without its view dependence (SH degree 0), in [0, 1]."""
    return sh_to_color(scene.sh[:, 0]).detach().clamp(0, 1)


def solid(scene: Gaussians, min_opacity: float) -> Bool[Tensor, " n"]:
    """Flag Gaussians of at least this opacity. Raises UsageError where there is none."""
    flags = scene.opacities >= min_opacity
    if not flags.any():
        raise UsageError(f"no Gaussian has an opacity of {min_opacity} or more: lower min_opacity")
    return flags


def as_gaussians(scene: Gaussians | SplatTable) -> Gaussians:
    return gaussians_of(scene) if isinstance(scene, SplatTable) else scene


def to_open3d(scene: Gaussians | SplatTable) -> Any:
    """An `open3d.t.geometry.PointCloud` with Open3D's names for splats.

    positions; scale `n 3` (linear); rot `n 4` (wxyz); opacity `n 1` (logit); f_dc `n 3`; f_rest
    `n k-1 3`. Its rotate() turns SH wrongly: turn the scene before.

    Raises GseditError where open3d cannot be loaded.
    """
    open3d, scene = import_open3d(), as_gaussians(scene)
    fields = {
        "positions": scene.means,
        "scale": scene.scales,
        "rot": scene.quats,
        "opacity": scene.logit_opacities[:, None],
        "f_dc": scene.sh[:, 0],
        "f_rest": scene.sh[:, 1:],
    }
    if not fields["f_rest"].numel():
        del fields["f_rest"]
    cloud = open3d.t.geometry.PointCloud()
    for name, field in fields.items():
        values = field.detach().float().contiguous().cpu().numpy()
        cloud.point[name] = open3d.core.Tensor.from_numpy(values).clone()
    return cloud


def to_pyvista(scene: Gaussians | SplatTable) -> Any:
    """A `pyvista.PolyData` of the centers, with `rgb` (uint8), `opacity` and `scales`.

    Raises GseditError where pyvista cannot be loaded.
    """
    pyvista, scene = import_pyvista(), as_gaussians(scene)
    cloud = pyvista.PolyData(scene.means.detach().double().cpu().numpy())
    cloud["rgb"] = eight_bits(splat_colors(scene))
    cloud["opacity"] = scene.opacities.detach().cpu().numpy()
    cloud["scales"] = scene.scales.detach().cpu().numpy()
    return cloud


def to_trimesh(scene: Gaussians | SplatTable) -> Any:
    """A `trimesh.PointCloud` of the centers, with colors and opacities as RGBA (uint8).

    Its export() writes a bare point cloud (.ply, .glb, .xyz): without sizes and rotations.

    Raises GseditError where trimesh cannot be loaded.
    """
    trimesh = load_package("trimesh", "trimesh cannot be loaded", "pip install trimesh")
    scene = as_gaussians(scene)
    rgba = torch.cat((splat_colors(scene), scene.opacities.detach()[:, None]), dim=1)
    vertices = scene.means.detach().double().cpu().numpy()
    return trimesh.PointCloud(vertices=vertices, colors=eight_bits(rgba))
