"""Gaussians that growths are made of: layers, tufts and fallen leaves. `m` Gaussians."""

from __future__ import annotations

from math import ceil, tau

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.orbit import perpendicular
from gsedit.objects.growth.layer import Patch, assembled, discs
from gsedit.objects.growth.spots import Spots
from gsedit.objects.growth.table import Growth
from rasterizer.scene import Gaussians, concatenate

HIDING = 0.4
"""Share of the usual thickness at which a layer hides what is under it."""
TUFT_TILT, TUFT_LONG, TUFT_WIDE = 0.45, 0.8, 0.4
"""Standard deviation of the tilt of a tuft against its normal; its length in the layer's thickness
and its width in pixels, as standard deviations."""
TUFT_UP = 0.35
"""Share of up in the direction of a tuft on a wall."""
AUTUMN = (
    (0.86, 0.55, 0.13), (0.8, 0.36, 0.1), (0.62, 0.2, 0.1), (0.72, 0.46, 0.16),
    (0.5, 0.3, 0.14), (0.9, 0.7, 0.22), (0.42, 0.25, 0.13),
)  # fmt: skip
"""Display colors of fallen leaves."""
LEAF = (
    # along, across, length, width, brightness: standard deviations, in leaf lengths
    (-0.42, 0.0, 0.10, 0.014, 0.5), (-0.24, 0.0, 0.07, 0.10, 0.86), (-0.1, 0.08, 0.09, 0.08, 1.0),
    (-0.1, -0.08, 0.09, 0.08, 0.94), (0.08, 0.07, 0.09, 0.075, 1.06), (0.08, -0.07, 0.09, 0.075, 1),
    (0.24, 0.0, 0.08, 0.075, 1.04), (0.38, 0.0, 0.065, 0.03, 1.1), (0.06, 0.0, 0.2, 0.009, 0.68),
)  # fmt: skip
"""Gaussians of a leaf: the stem, the blade and its vein."""
LEAF_AREA = 0.22
"""Area of a leaf, in squares of its length."""
LITTER = 0.45
"""Area of the leaves against that of the ground, for the usual amount."""
LEAF_TILT, LEAF_PILE = 0.22, 0.3
"""Standard deviation of a leaf's tilt, and how high leaves lie on each other, in their length."""


def hidden(patch: Patch, growth: Growth) -> Float[Tensor, "h w"]:
    """Share of each pixel that a growth hides."""
    full = HIDING * growth.thickness * patch.site.size
    return growth.opacity * patch.share * (patch.height / full).clamp(0, 1)


def layer(patch: Patch, growth: Growth) -> Gaussians:
    """A sheet of discs on top of a patch."""
    top = patch.top
    spots = patch.spots(top)
    share = patch.share[patch.lies] if growth.opacity < 0.9 else torch.ones(len(spots)).double()
    return discs(spots.points, spots.normals, top, growth.opacity * share, colors_of(spots, growth))


def colors_of(spots: Spots, growth: Growth) -> Float[Tensor, "m 3"]:
    """Display colors in the present light, mottled."""
    random = torch.randn(len(spots), generator=torch.Generator().manual_seed(0)).double()
    level = spots.rise.abs()  # discs are long where it is steep: mottles would be streaks
    mottle = 1 + growth.mottle * level * random.clamp(-2, 2)
    return spots.shaded(growth.shade, growth.lit, spots.light()) * mottle[:, None]


def tufts(patch: Patch, growth: Growth, amount: float) -> Gaussians:
    """A mat of discs, and short tufts that stand out of it, some lighter than others."""
    relief, spots = patch.top, patch.spots(patch.top)
    colors = colors_of(spots, growth)
    mat = discs(spots.points, spots.normals, relief, growth.opacity, 0.72 * colors)
    generator = torch.Generator().manual_seed(1)
    count = len(spots)
    tilt = TUFT_TILT * torch.randn(count, 3, generator=generator).double()
    ways = torch.nn.functional.normalize(spots.normals + TUFT_UP * patch.site.up + tilt, dim=-1)
    most = amount * growth.thickness * patch.site.size
    long = most * TUFT_LONG * (0.4 + torch.rand(count, generator=generator).double())
    shift = (torch.rand(count, 3, generator=generator).double() - 0.5) * relief.pixel
    points = spots.points + shift + 0.6 * long[:, None] * ways
    wide = torch.full_like(long, TUFT_WIDE * relief.pixel)
    bright = 0.85 + 0.5 * torch.rand(count, generator=generator).double()
    standing = assembled(
        points, ways, perpendicular(ways), torch.stack((long / 1.5, wide, wide), -1), 0.8,
        colors * bright[:, None],
    )  # fmt: skip
    return concatenate(mat, standing)


def leaves(patch: Patch, growth: Growth, amount: float, most: int) -> Gaussians:
    """Single leaves, of LEAF Gaussians each, strewn over a patch; at most `most` Gaussians."""
    random = np.random.default_rng(0)
    length = growth.thickness * patch.site.size
    density = patch.share[patch.lies].numpy()
    area = float(density.sum()) * patch.relief.pixel**2
    count = min(ceil(amount * LITTER * area / (LEAF_AREA * length**2)), most // len(LEAF))
    rows = torch.from_numpy(random.choice(len(density), count, p=density / density.sum()))
    ground = patch.spots(patch.relief)[rows]
    shift, tilt = (
        torch.from_numpy(random.uniform(-0.5, 0.5, (count, 2))),
        random.normal(size=(count, 3)),
    )
    points = ground.points + patch.relief.pixel * (
        shift[:, :1] * patch.relief.right + shift[:, 1:] * patch.relief.down
    )
    normals = torch.nn.functional.normalize(
        ground.normals + LEAF_TILT * torch.from_numpy(tilt), dim=-1
    )
    turn = torch.from_numpy(random.uniform(0, tau, count))[:, None]
    first = perpendicular(normals)
    second = torch.linalg.cross(normals, first)
    along = turn.cos() * first + turn.sin() * second
    sizes = length * torch.from_numpy(random.uniform(0.65, 1.2, count))
    lift = length * torch.from_numpy(random.uniform(0.06, LEAF_PILE, count))
    palette = torch.tensor(AUTUMN).double()[
        torch.from_numpy(random.integers(len(AUTUMN), size=count))
    ]
    mottle = torch.from_numpy(1 + growth.mottle * random.normal(size=(count, 1)))
    light = ground.shaded(growth.shade, growth.lit, ground.light())
    return _leaf_shapes(
        points + lift[:, None] * normals, along, normals, sizes, palette * mottle * light
    )


def _leaf_shapes(
    points: Float[Tensor, "c 3"],
    along: Float[Tensor, "c 3"],
    normals: Float[Tensor, "c 3"],
    sizes: Float[Tensor, " c"],
    colors: Float[Tensor, "c 3"],
) -> Gaussians:
    """The LEAF Gaussians of each of `c` leaves, the tips curled up."""
    shape = torch.tensor(LEAF).double()
    across = torch.linalg.cross(normals, along)
    curl = 0.5 * shape[:, 0].square() + 1.5 * shape[:, 1].square() + 0.01 * (shape[:, 3] < 0.02)
    offsets = torch.stack((shape[:, 0], shape[:, 1], curl), -1)
    frames = torch.stack((along, across, normals), 1)
    at = points[:, None] + sizes[:, None, None] * (offsets @ frames)
    thin = torch.full_like(shape[:, 2], 0.008)
    scales = sizes[:, None, None] * torch.stack((shape[:, 2], shape[:, 3], thin), -1)
    shown = colors[:, None] * shape[:, 4][:, None]
    each = len(LEAF)
    return assembled(
        at.reshape(-1, 3), along.repeat_interleave(each, 0), normals.repeat_interleave(each, 0),
        scales.reshape(-1, 3), 0.97, shown.reshape(-1, 3),
    )  # fmt: skip
