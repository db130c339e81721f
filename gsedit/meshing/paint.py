"""Colors of a mesh's vertices, from the pictures that see them. `v` vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsedit.meshing.triangles import Mesh
from gsedit.scene.neighbors import k_nearest
from gsedit.surface.depth import SeenSurface

HIDDEN_VOXELS = 3.0
"""Distance behind what a view sees, in voxels, from which a vertex is hidden."""
FACING = 4
"""Power of the cosine to a view by which its color counts: slanted looks are smeared."""
GREY = 0.5
"""Color of vertices where no view sees any."""


def painted(
    mesh: Mesh, surfaces: Sequence[SeenSurface], voxel: float
) -> Float64[np.ndarray, "v 3"]:
    """Colors of the vertices, sRGB in [0, 1]: means over the views that see them, by how straight
    and near they look. Those that none sees take that of the nearest one that is seen."""
    points, normals = torch.from_numpy(mesh.vertices), torch.from_numpy(mesh.normals)
    total, weight = torch.zeros_like(points), points.new_zeros(len(points))
    for surface in surfaces:
        color, strength = _seen(points, normals, surface, HIDDEN_VOXELS * voxel)
        total += strength[:, None] * color
        weight += strength
    seen = (weight > 0).numpy()
    colors = (total / weight.clamp_min(1e-300)[:, None]).clamp(0, 1).numpy()
    if not seen.any():
        return np.full_like(colors, GREY)
    if not seen.all():
        _, near = k_nearest(mesh.vertices[seen], mesh.vertices[~seen], 1)
        colors[~seen] = colors[seen][near[:, 0]]
    return colors


def _seen(
    points: Float[Tensor, "v 3"],
    normals: Float[Tensor, "v 3"],
    surface: SeenSurface,
    behind: float,
) -> tuple[Float[Tensor, "v 3"], Float[Tensor, " v"]]:
    """Colors of vertices in a view, and their weights: 0 where it does not see them."""
    camera = surface.camera
    xy, z = camera.project(points)
    size = xy.new_tensor((camera.width, camera.height))
    grid = (2 * xy / size - 1)[None, None].float()
    maps = torch.cat((surface.color, surface.alpha[..., None]), -1).movedim(-1, 0)[None].float()
    color = torch.nn.functional.grid_sample(maps, grid, align_corners=False)[0, :, 0].T.double()
    depth = torch.nn.functional.grid_sample(
        surface.depth[None, None].float(), grid, mode="nearest", align_corners=False
    )[0, 0, 0].double()
    towards = torch.nn.functional.normalize(camera.center.to(points) - points, dim=-1)
    straight = (normals * towards).sum(-1).clamp_min(0)
    inside = (z > 0) & ((xy > 0) & (xy < size)).all(-1) & (depth > 0)
    visible = inside & ((z - depth).abs() < behind)
    strength = visible * straight**FACING / z.clamp_min(1e-300).square()
    return color[:, :3] / color[:, 3:].clamp_min(0.5), strength
