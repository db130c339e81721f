"""Icicles: tapering chains of Gaussians that hang from edges. `m` places, `j` joints of each."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.objects.growth.bodies import layer
from gsedit.objects.growth.layer import Patch, assembled
from gsedit.objects.growth.table import Growth
from gsedit.scene.neighbors import k_nearest
from rasterizer.numerics import sh_to_color
from rasterizer.scene import Gaussians, concatenate

LENGTH = 14.0
"""Longest icicle, in the thickness of the glaze."""
APART = 2.6
"""Mean distance of icicles along an edge, in their radius at the top."""
RADIUS = 0.085
"""Radius at the top, in the length."""
JOINTS = 9
"""Gaussians of an icicle."""
FREE = 0.8
"""Longest icicle, in the fall of the edge that it hangs from."""
FALL_PIXELS = 3
"""Pixels beyond an edge within which the surface under it is looked for."""
LEAST_FALL = 0.45
"""Fall of an edge that an icicle hangs from, in the longest."""
BESIDE = 4
"""Pixels from an edge within which ice lies that drips from it."""
SHORTEST = 0.12
"""Shortest icicle, in the longest."""
OPACITY = 0.72


def iced(patch: Patch, growth: Growth, amount: float) -> Gaussians:
    """A glaze, and icicles along its edges."""
    glaze = layer(patch, growth)
    if not len(glaze):
        return glaze
    colors = sh_to_color(glaze.sh[:, 0].double())
    return concatenate(glaze, icicles(patch, growth, amount, colors))


def icicles(patch: Patch, growth: Growth, amount: float, glaze: Float[Tensor, "p 3"]) -> Gaussians:
    """Icicles along the edges of what is iced, no longer than the edge falls; `glaze` are the
    display colors of what is iced, `p` pixels."""
    random = np.random.default_rng(2)
    longest = LENGTH * amount * growth.thickness * patch.site.size
    points, fall, pixels = _edges(patch, longest)
    share = min(1.0, patch.relief.pixel / (APART * RADIUS * longest))
    kept = torch.from_numpy(random.random(len(points)) < share)
    points, fall = points[kept], fall[kept]
    length = longest * torch.from_numpy(random.beta(1.6, 2.6, len(points)) + SHORTEST)
    near = k_nearest(patch.lies.nonzero().double().numpy(), pixels[kept].double().numpy(), 1)[1][
        :, 0
    ]
    tint = glaze[torch.from_numpy(near)]
    return _hanging(points, torch.minimum(length, FREE * fall), tint, patch)


def _edges(
    patch: Patch, longest: float
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"], Int[Tensor, "m 2"]]:
    """Points of edges beside what is iced, how far the surface falls there, and their pixels."""
    relief = patch.relief
    heights = relief.heights
    bottom = float(heights[relief.there].min()) - longest  # where nothing is, a fall is far
    heights = heights.masked_fill(~relief.there, bottom)
    fall = heights + _most(-heights, FALL_PIXELS)
    edge = relief.brinks(LEAST_FALL * longest) & (_most(patch.lies.double(), BESIDE) > 0)
    return relief.points[edge], fall[edge], edge.nonzero()


def _most(values: Float[Tensor, "h w"], pixels: int) -> Float[Tensor, "h w"]:
    """The largest value within some pixels of each."""
    return torch.nn.functional.max_pool2d(values[None, None], 2 * pixels + 1, 1, pixels)[0, 0]


def _hanging(
    points: Float[Tensor, "m 3"],
    length: Float[Tensor, " m"],
    tint: Float[Tensor, "m 3"],
    patch: Patch,
) -> Gaussians:
    up = patch.site.up
    along = (torch.arange(JOINTS).double() + 0.5) / JOINTS
    taper = RADIUS * (1 - along) ** 0.8 + 0.008
    radius = length[:, None] * taper * 0.75
    at = points[:, None] - (length[:, None] * (along - 0.08))[..., None] * up
    long = length[:, None].expand(-1, JOINTS) / JOINTS * 0.75
    scales = torch.stack((long, radius, radius), -1)
    bright = 0.86 + 0.18 * along
    colors = (tint[:, None] * bright[:, None]).expand(-1, JOINTS, 3)
    ways = up.expand(at.numel() // 3, 3)
    return assembled(
        at.reshape(-1, 3), ways, perpendicular(ways), scales.reshape(-1, 3), OPACITY,
        colors.reshape(-1, 3),
    )  # fmt: skip
