"""Carving of a surface, told from its paint: what of the old colors stays under a new material.

A Gaussian that is darker than those around it lies in a carved line, or is painted so. It counts as
carved as far as its hue is that of its surroundings; where the surface is hollow it is sure. A dark
stripe of the same hue on a flat surface is taken for carving: it stays, as a faint shadow. `n`
Gaussians, all of one subject.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.scene.color_space import LUMINANCE, linear_of_srgb
from gsedit.surface.means import neighbor_means
from rasterizer.numerics import sh_to_color
from rasterizer.scene import Gaussians

ROUNDS = 12
"""Means over the nearest neighbors, one after the other: the surroundings of a Gaussian."""
DETAIL = (0.45, 1.15)
"""Least and largest ratio to the surroundings, in linear light, that counts as carving."""
HUE = 0.12
"""Difference in the share of a channel at which a color is half paint."""
FLAT = 0.6
"""Share of darkness that stays where the surface is not hollow."""
DEPTH = 3.0
"""Slope of a carved line, against the change of the logarithm of light between neighbors."""
HOLLOW = 0.12
"""Mean sine at which neighbors stand above a surface that is fully hollow."""


@dataclass(frozen=True, eq=False)
class Relief:
    """How a surface is carved."""

    detail: Float[Tensor, " n"]
    """Factor on the light, about 1 where nothing is carved."""
    hollow: Float[Tensor, " n"]
    """How hollow or carved it is there, in [0, 1]."""
    color: Float[Tensor, "n 3"]
    """Linear color of the surroundings of each Gaussian on the surface."""

    @property
    def luminance(self) -> Float[Tensor, " n"]:
        """Linear luminance of that color."""
        return self.color @ torch.from_numpy(LUMINANCE).to(self.color)


def visible_area(part: Gaussians) -> Float[Tensor, " n"]:
    """Opacity times the area of the largest face: how much of a picture a Gaussian fills."""
    return part.opacities * part.log_scales.sort(-1).values[:, 1:].sum(-1).exp() + 1e-12


def carved(part: Gaussians, normals: Float[Tensor, "n 3"], rows: Int[Tensor, "n k"]) -> Relief:
    """The relief of a subject's Gaussians; `rows` are those of the nearest to each."""
    weights = torch.from_numpy(LUMINANCE).to(part.means)
    display = sh_to_color(part.sh[:, 0]).clamp(0, 1).double().numpy()
    linear = torch.from_numpy(linear_of_srgb(display)).to(part.means) + 1e-3
    if not rows.shape[1]:
        ones = part.means.new_ones(len(part))
        return Relief(ones, torch.zeros_like(ones), linear)
    size = visible_area(part)[:, None]
    around = neighbor_means(
        torch.cat((linear, torch.ones_like(linear[:, :1])), 1) * size, rows, ROUNDS
    )
    around = around[:, :3] / around[:, 3:]
    near = neighbor_means(linear, rows, 1)
    ratio = (near @ weights) / (around @ weights)
    hue = (near / near.sum(1, keepdim=True) - around / around.sum(1, keepdim=True)).abs().amax(1)
    hue = hue * ratio.clamp(0, 1)  # what is black has no hue: it may be a crack
    stone = 1 / (1 + (hue / HUE).square())
    offset = torch.nn.functional.normalize(part.means[rows] - part.means[:, None], dim=-1)
    rise = neighbor_means(((offset * normals[:, None]).sum(-1)).mean(1, keepdim=True), rows, 2)[
        :, 0
    ]
    hollow = (rise / HOLLOW).clamp(0, 1)
    kept = stone * (FLAT + (1 - FLAT) * hollow)
    detail = ratio.clamp(*DETAIL) ** kept
    dark = ((1 - ratio) / (1 - DETAIL[0])).clamp(0, 1) * stone
    return Relief(detail, torch.maximum(hollow, dark).clamp(0, 1), around)


def engraved(
    points: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    relief: Relief,
    rows: Int[Tensor, "n k"],
) -> Float[Tensor, "n 3"]:
    """Unit normals as if what is dark lay deeper: carving that is finer than the normals show
    turns reflections too."""
    if not rows.shape[1]:
        return normals
    height = relief.detail.log()
    offset = torch.nn.functional.normalize(points[rows] - points[:, None], dim=-1)
    slope = ((height[rows] - height[:, None])[..., None] * offset).mean(1)
    slope = slope - (slope * normals).sum(-1, keepdim=True) * normals
    return torch.nn.functional.normalize(normals - DEPTH * slope, dim=-1)
