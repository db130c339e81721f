"""Gaussians that a layer covers: they stay where they are, in the layer's color.

Gaussians are blended in the order of their centers, and reach farther than the layer is thick: in
their old color they would be seen through it. `n` Gaussians, `m` new ones; `h w` pixels.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import step
from gsedit.objects.growth.layer import Patch
from gsedit.scene.neighbors import k_nearest
from rasterizer.scene import Gaussians

DEEP = 5.0
"""Depth under the surface, in pixels, up to which Gaussians are of the surface; and, for wide ones,
in their own largest standard deviations, with half of DEEP."""
FACING = (0.0, 0.4)
"""Cosine between a normal and the axis from which a surface begins to be covered, and is."""
HIDDEN = (0.3, 0.9)
"""Share of a pixel that is hidden at which what is under it begins to take a color, and has it."""
NEAREST = 4
"""New Gaussians whose mean color one takes."""


def buried(
    scene: Gaussians, patch: Patch, hidden: Float[Tensor, "h w"]
) -> Float[Tensor, " n"]:
    """Share, in [0, 1], that a layer covers of each Gaussian, from what it hides of each pixel."""
    site, relief = patch.site, patch.relief
    h, w = relief.there.shape
    points = site.setting.found.surface.points[site.rows]
    offset = points - relief.points[0, 0]
    column = (offset @ relief.right / relief.pixel).round().long().clamp(0, w - 1)
    row = (offset @ relief.down / relief.pixel).round().long().clamp(0, h - 1)
    below = relief.heights[row, column] - points @ relief.axis
    reach = (DEEP / 2 * scene.scales[site.rows].amax(-1).double()).clamp_min(DEEP * relief.pixel)
    near = step(below / reach, 2.0, 1.0)
    facing = step(site.setting.found.surface.normals[site.rows] @ relief.axis, *FACING)
    share = torch.zeros(len(scene), dtype=torch.float64)
    share[site.rows] = near * facing * step(hidden[row, column], *HIDDEN)
    return share


def in_colors_of(scene: Gaussians, share: Float[Tensor, " n"], new: Gaussians) -> Gaussians:
    """The scene with a share of each Gaussian in the color of the new ones nearest to it; both have
    SH of one degree."""
    rows = (share > 0).nonzero().squeeze(-1)
    if not len(rows) or not len(new):
        return scene
    nearest = min(NEAREST, len(new))
    near = k_nearest(new.means.numpy(), scene.means[rows].detach().numpy(), nearest)[1]
    color = new.sh[torch.from_numpy(near)].mean(1)
    sh = scene.sh.detach().clone()
    mixed = share[rows][:, None, None].to(sh)
    sh[rows] = sh[rows] * (1 - mixed) + mixed * color
    return replace(scene, sh=sh)
