"""A small scene as the arguments of gsplat's `rasterization`."""

from __future__ import annotations

from dataclasses import replace

import torch
from closeness import weights_like
from scenes import camera, random_cloud

from rasterizer import Camera, Gaussians

DTYPES = [torch.float64, torch.float32]


BACKGROUND = torch.tensor((0.2, 0.5, 0.9), dtype=torch.float64)


def ortho() -> Camera:
    """Eight pixels a unit: the cloud's spread fills the picture."""
    return replace(camera(), fx=8.0, fy=8.4, model="ortho")


def cloud(degree: int = 2) -> Gaussians:
    """Sparse: no tile is finished, so that every picture here is the whole sum."""
    return random_cloud(60, seed=3, degree=degree)


def gsplat_arguments(scene: Gaussians, *views: Camera) -> dict[str, object]:
    """gsplat's arguments for a scene with harmonics, in the scene's dtype."""
    first = views[0]
    intrinsics = [[[v.fx, 0, v.cx], [0, v.fy, v.cy], [0, 0, 1]] for v in views]
    return {
        "means": scene.means,
        "quats": scene.quats,
        "scales": scene.scales,
        "opacities": scene.opacities,
        "colors": scene.sh,
        "viewmats": torch.stack([v.world_to_camera for v in views]).to(scene.means),
        "Ks": torch.tensor(intrinsics, dtype=scene.means.dtype),
        "width": first.width,
        "height": first.height,
        "sh_degree": scene.degree,
    }


def loss_of(color: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
    return (color * weights_like(color)).sum() + (alpha * weights_like(alpha, 1)).sum()
