"""Panoramas from a point, rendered from a sample of the Gaussians in milliseconds.

A panorama has `b` bins, the cells of the six faces of a cube. Each of `m` sampled Gaussians counts
in the bin of its center, and one that is wider than a bin also in those that it covers; in each bin
the opacities are blended from front to back. Coarse, but enough to tell a place from which a scene
was captured from a place behind its walls, of which hundreds are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

SIDE = 10
"""Cells a side of a face: 9 degrees."""
SAMPLED_GAUSSIANS = 20_000
WIDE = 0.08
"""Angular radius, radians, about half a cell: wider ones are spread over cells."""
MOST_WIDE = 300
BLURRED = 0.06
"""Angular radius, radians, of a splat in which no detail is seen: a 20th of a 70 degree picture."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Gaussians drawn at random from a scene, in the numbers that a panorama needs. Float32."""

    means: Float[Tensor, "m 3"]
    depth: Float[Tensor, " m"]
    """Optical depth through the center, times the number of Gaussians that each one stands for."""
    areas: Float[Tensor, "m 3 3"]
    """v^T areas v is the square of the area 2 pi s s' across the unit direction v, world units."""
    size: Float[Tensor, " m"]
    """Geometric mean of the two larger standard deviations."""
    normals: Float[Tensor, "m 3"]
    """The thin axis: of a surface its normal, of either sign."""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Sums over the Gaussians of each bin, by their blending weights times the solid angle."""

    weight: Float[Tensor, " b"]
    square: Float[Tensor, " b"]
    """Sum of the squared weights: few Gaussians with large weights make a blurred picture."""
    blurred: Float[Tensor, " b"]
    """Sum of the weights of Gaussians that are wider than BLURRED."""
    log_distance: Float[Tensor, " b"]

    @property
    def reach(self) -> Float[Tensor, ""]:
        """Geometric mean distance of what is seen, world units."""
        return (self.log_distance.sum() / self.weight.sum().clamp_min(1e-9)).exp()


def draw_sample(
    scene: Gaussians, generator: torch.Generator, count: int = SAMPLED_GAUSSIANS
) -> Sample:
    """`count` Gaussians of a scene, or all if there are fewer."""
    rows = torch.randperm(len(scene), generator=generator)[:count]
    some = scene[rows].to(torch.float32)
    scales = some.scales
    across = torch.stack([scales[:, 1] * scales[:, 2], scales[:, 0] * scales[:, 2],
                          scales[:, 0] * scales[:, 1]], -1)  # fmt: skip
    turned = rotation_matrices(some.quats)
    axes = turned * (2 * torch.pi * across)[:, None]
    thin = scales.argmin(-1)[:, None, None].expand(-1, 3, 1)
    larger = scales.sort(-1).values[:, 1:]
    depth = -torch.log1p(-some.opacities.clamp_max(0.99)) * (len(scene) / len(rows))
    return Sample(some.means, depth, axes @ axes.mT, larger.prod(-1).sqrt(),
                  turned.gather(2, thin)[..., 0])  # fmt: skip


@lru_cache(maxsize=1)  # hundreds of places are compared
def bin_directions() -> tuple[Float[Tensor, "b 3"], Float[Tensor, " b"]]:
    """The unit direction of each bin's center, and its solid angle."""
    grid = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
    u, v = (x.reshape(-1) for x in torch.meshgrid(grid, grid, indexing="ij"))
    one = torch.ones_like(u)
    faces = []
    for axis in range(3):
        for sign in (1, -1):
            columns = [u, v]
            columns.insert(axis, sign * one)
            faces.append(torch.stack(columns, -1))
    directions = torch.cat(faces)
    solid = (2 / SIDE) ** 2 / directions.norm(dim=-1) ** 3
    return torch.nn.functional.normalize(directions, dim=-1), solid


def _bins(vectors: Float[Tensor, "m 3"]) -> Int[Tensor, " m"]:
    """The bin that each direction falls into, in the order of `bin_directions`."""
    x, y, z = vectors.abs().unbind(-1)
    axis = torch.where(x >= torch.maximum(y, z), 0, torch.where(y >= z, 1, 2))
    along = vectors.gather(-1, axis[:, None])[:, 0]
    others = torch.tensor([[1, 2], [0, 2], [0, 1]])[axis]
    uv = vectors.gather(-1, others) / along.abs().clamp_min(1e-12)[:, None]
    cell = ((uv + 1) * (SIDE / 2)).long().clamp(0, SIDE - 1)
    return (2 * axis + (along < 0)) * SIDE**2 + cell[:, 0] * SIDE + cell[:, 1]


def _covered(
    towards: Float[Tensor, "w 3"], radius: Float[Tensor, " w"], directions: Float[Tensor, "b 3"]
) -> tuple[Int[Tensor, " c"], Int[Tensor, " c"], Float[Tensor, " c"]]:
    """Pairs of wide Gaussians and bins within two of their radii, with the angles in radii."""
    cosine = (towards @ directions.T).clamp(-1, 1)
    least = torch.cos((2 * radius + 0.01).clamp_max(pi))  # angles are slow: only of these pairs
    wide, bins = (cosine >= least[:, None]).nonzero().unbind(-1)
    angle = torch.acos(cosine[wide, bins]) / radius[wide]
    near = angle < 2
    return wide[near], bins[near], angle[near]


def _front_to_back(cell: Int[Tensor, " m"], distance: Float[Tensor, " m"]) -> Int[Tensor, " m"]:
    """The order by cell, and in each by distance, which is positive.

    Floats of one sign are ordered as their bits are, 16 of which at a time sort 10 times faster.
    """
    bits = distance.numpy().view(np.uint32)
    order = np.arange(len(bits))
    for key in (bits, bits >> 16, cell.numpy()):
        order = order[np.argsort(key.astype(np.uint16)[order], kind="stable")]
    return torch.from_numpy(order)


def panorama(sample: Sample, point: Float[Tensor, "3"]) -> Panorama:
    """The panorama at a point."""
    directions, solid = bin_directions()
    offset = sample.means - point.float()
    distance = offset.norm(dim=-1).clamp_min(1e-9)
    towards = offset / distance[:, None]
    radius = sample.size / distance
    area = torch.einsum("mi,mij,mj->m", towards, sample.areas, towards).clamp_min(0).sqrt()
    cell = _bins(towards)
    depth = sample.depth * (area / distance**2 / solid[cell]).clamp_max(1)
    rows = torch.arange(len(cell))
    wide = (radius > WIDE).nonzero()[:, 0]
    wide = wide[(radius[wide].clamp_max(1) ** 2 * sample.depth[wide]).argsort(descending=True)]
    wide = wide[:MOST_WIDE]
    if len(wide):
        covered, covering, angle = _covered(towards[wide], radius[wide], directions)
        depth[wide] = 0
        spread = sample.depth[wide[covered]] * torch.exp(-(angle**2) / 2)
        rows, cell = torch.cat((rows, wide[covered])), torch.cat((cell, covering))
        depth = torch.cat((depth, spread))
    order = _front_to_back(cell, distance[rows])
    rows, cell, depth = rows[order], cell[order], depth[order].double()
    through = depth.cumsum(0)
    first = torch.searchsorted(cell, torch.arange(len(solid)))
    before = torch.cat((through.new_zeros(1), through))[first][cell]
    weight = (torch.exp(-(through - depth - before)) * -torch.expm1(-depth)).float() * solid[cell]

    def total(values: Float[Tensor, " k"]) -> Float[Tensor, " b"]:
        return torch.zeros(len(solid)).index_add(0, cell, values)

    return Panorama(
        total(weight),
        total(weight * weight),
        total(weight * (radius[rows] > BLURRED)),
        total(weight * distance[rows].log()),
    )
