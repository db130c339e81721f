"""Gaussians that a layer covers: they stay where they are, in the layer's color.

Gaussians are blended in the order of their centers, and reach farther than the layer is thick: in
their old color they would be seen through it. `n` Gaussians, `m` new ones; `h w` pixels.
"""

from __future__ import annotations

from dataclasses import replace
from math import tau

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import step
from gsedit.objects.growth.layer import Patch
from gsedit.scene.neighbors import k_nearest
from gsedit.surface.relief import Relief
from rasterizer.numerics import AUTO, Execution
from rasterizer.project import rotation_matrices
from rasterizer.render import backproject
from rasterizer.scene import Gaussians

SEEN = (0.03, 0.2)
"""Share of a Gaussian that is seen along the axis from which it begins to be of the surface, and
is."""
HIDDEN = (0.3, 0.8)
"""Share of what is seen of it that is hidden from which it begins to take a color, and has it."""
NEAREST = 4
"""New Gaussians whose mean color one takes."""


def buried(
    scene: Gaussians, patch: Patch, hidden: Float[Tensor, "h w"], execution: Execution = AUTO
) -> Float[Tensor, " n"]:
    """Share, in [0, 1], that a layer covers of each Gaussian, from what it hides of each pixel."""
    relief, rows = patch.relief, patch.site.rows
    part = scene[rows]
    maps = torch.stack((hidden, torch.ones_like(hidden), torch.zeros_like(hidden)), -1)
    covered, seen, _ = backproject(part, relief.camera, maps, execution=execution).double().T
    mean = covered / seen.clamp_min(1e-9)
    share = torch.zeros(len(scene), dtype=torch.float64)
    share[rows] = step(seen / _area(part, relief), *SEEN) * step(mean, *HIDDEN)
    return share


def _area(part: Gaussians, relief: Relief) -> Float[Tensor, " k"]:
    """Sum of each Gaussian's opacity over the pixels, with nothing before it; at least one's."""
    plane = torch.stack((relief.right, relief.down)) / relief.pixel
    axes = plane @ rotation_matrices(part.quats.double()) * part.scales.double()[:, None]
    spread = torch.linalg.det(axes @ axes.mT).clamp_min(0).sqrt()
    return tau * part.opacities.double() * spread.clamp_min(1 / tau)


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
