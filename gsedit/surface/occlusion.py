"""Shadow of a subject on itself: its Gaussians as cells of a grid, and rays through them.

`n` Gaussians, `m` points, `d` directions; `g` cells a side.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rasterizer.scene import Gaussians

CELLS = 64
"""Cells along the longest side of a subject."""
FEWEST_CELLS = 12
"""Cells along that side of a subject of few, wide Gaussians."""
OPAQUE = 0.3
"""Opacity below which a Gaussian hides nothing."""
START_CELLS = 2.0
"""Distance from a surface, in cells, at which a ray starts: nearer cells are the surface itself."""
STEPS = 20
"""Points of a ray that are looked at; each step is longer than the one before."""
GROWTH = 1.1
"""Length of a step against the one before."""
AT_ONCE = 1 << 16
"""Rays that are followed at once: what a step computes of them stays in a cache of 1 MB."""


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Cells of a subject's bounding box that something opaque is in."""

    low: Float[Tensor, "3"]
    """Corner of the box, world units."""
    cell: float
    """Side of a cell, world units."""
    full: Bool[Tensor, "gx gy gz"]
    """Whether something is in a cell; those at the border are empty."""


def occupancy(subject: Gaussians) -> Occupancy:
    """The grid of a subject; cells are no smaller than its Gaussians are wide."""
    points = subject.means[subject.opacities > OPAQUE]
    points = points if len(points) else subject.means
    low, high = points.amin(0), points.amax(0)
    side = float((high - low).amax().clamp_min(1e-9))
    wide = float(subject.log_scales.sort(-1).values[:, 1].median().exp())
    cell = min(max(side / CELLS, 1.5 * wide), side / FEWEST_CELLS)
    low = low - 1.5 * cell
    size = ((high - low) / cell).long() + 3
    full = torch.zeros([int(each) for each in size], dtype=torch.bool)
    full[tuple(((points - low) / cell).long().T)] = True
    return Occupancy(low, cell, full)


def nothing(subject: Gaussians) -> Occupancy:
    """A grid where a subject is, in which nothing hides anything."""
    low = subject.means.amin(0)
    side = float((subject.means.amax(0) - low).amax().clamp_min(1e-9))
    return Occupancy(low, side, torch.zeros(3, 3, 3, dtype=torch.bool))


def open_share(
    grid: Occupancy,
    points: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    directions: Float[Tensor, "m d 3"],
) -> Float[Tensor, "m d"]:
    """1 for each ray from a point on the surface that leaves the subject, 0 for one that meets it.

    Rays start START_CELLS off the surface: hollows that are narrower are not seen.
    """
    start = points + START_CELLS * grid.cell * normals
    rays = max(1, AT_ONCE // max(directions.shape[1], 1))
    parts = zip(start.split(rays), directions.split(rays))
    return torch.cat([_open(grid, *part) for part in parts]) if len(points) else points[:, :0]


def _open(
    grid: Occupancy, start: Float[Tensor, "m 3"], directions: Float[Tensor, "m d 3"]
) -> Float[Tensor, "m d"]:
    count = directions.shape[1]
    lengths = GROWTH ** torch.arange(STEPS, dtype=torch.float32)
    # first steps of a cell, to the far corner with the last one
    reach = float(torch.tensor(grid.full.shape).double().norm()) * 0.6
    steps = lengths.cumsum(0) * (reach / float(lengths.sum()))
    at = [each.repeat_interleave(count) for each in ((start - grid.low) / grid.cell).unbind(-1)]
    along = [each.reshape(-1) for each in directions.unbind(-1)]
    full = grid.full.reshape(-1)
    met = torch.zeros(len(at[0]), dtype=torch.bool)
    for step in steps.tolist():
        index = torch.zeros_like(at[0])
        for origin, way, size in zip(at, along, grid.full.shape):
            cell = torch.add(origin, way, alpha=step).floor_()
            index.mul_(size).add_(cell.clamp_(0, size - 1))  # the border is empty
        met |= full.index_select(0, index.int())
    return (~met).reshape(-1, count).to(directions)
