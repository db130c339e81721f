"""Which Gaussian touches which tile, in depth order. Integers: nothing here has a gradient.

`m` Gaussians sorted by depth, `t` tiles in rows, `p` (tile, Gaussian) pairs. Positions are
relative to the box's corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

TILE_SIZES = (8, 16, 32)
# Cost of a pair before any pixel is looked at, in units of one pixel of a pair: gather, sort,
# gradient row.
PAIR_OVERHEAD = 48.0


@dataclass(frozen=True, eq=False)
class Bins:
    """Each tile's Gaussians, front to back."""

    members: Int[Tensor, " p"]
    """Gaussian of each pair; pairs of one tile are contiguous."""
    starts: Int[Tensor, " t1"]
    """Tile i holds members[starts[i] : starts[i + 1]]; tiles are in row-major order."""
    slots: Int[Tensor, " p1"]
    """Where each pair stands when pairs are grouped by Gaussian; one more for the padding pair."""
    counts: Int[Tensor, " m"]
    """Pairs of each Gaussian."""
    size: int
    """Side of a tile, pixels."""
    columns: int
    rows: int


@dataclass(frozen=True, eq=False)
class Footprints:
    """Ellipses |W (p - xy)| <= radius outside of which alpha is below the floor."""

    xy: Float[Tensor, "m 2"]
    covariance: Float[Tensor, "m 4"]
    """xx, xy, yy, determinant."""
    radius: Float[Tensor, " m"]
    """In standard deviations; 0: never visible."""


@torch.no_grad()
def choose_tile_size(footprints: Footprints, width: int, height: int) -> int:
    """The side for which the pairs' pixels, plus each pair's overhead, are fewest."""
    half = footprints.radius[:, None] * footprints.covariance[:, ::2].sqrt()
    extent = torch.tensor((width, height), dtype=half.dtype)
    low = (footprints.xy - half).clamp_min(0).minimum(extent)
    span = ((footprints.xy + half).minimum(extent) - low).clamp_min(0)

    def cost(size: int) -> float:
        tiles = (span / size + 1).prod(-1).sum().item()
        return tiles * (size * size + PAIR_OVERHEAD)

    return min(TILE_SIZES, key=cost)


def _span(
    low: Float[Tensor, " m"], high: Float[Tensor, " m"], size: int, count: int
) -> tuple[Int[Tensor, " m"], Int[Tensor, " m"]]:
    """First tile and number of tiles with a pixel centre in [low, high]."""
    first = ((low + 0.5) / size - 1).ceil().clamp(0, count)
    last = ((high - 0.5) / size).floor().clamp(-1, count - 1)
    return first.long(), (last - first + 1).clamp_min(0).long()


def _expand(counts: Int[Tensor, " m"]) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
    """(owner, rank) of each of sum(counts) items: owner i has ranks 0 .. counts[i] - 1."""
    owner = torch.repeat_interleave(counts)
    first = counts.cumsum(0) - counts
    return owner, torch.arange(owner.shape[0]) - first[owner]


@torch.no_grad()
def bin_tiles(footprints: Footprints, size: int, width: int, height: int) -> Bins:
    """List the Gaussians of every tile that an ellipse touches: exact, a row of tiles at a time."""
    columns, rows = -(-width // size), -(-height // size)
    # Rounding must never lose a pair: a superset is harmless, each pixel tests its own alpha.
    radius = footprints.radius * 1.0005 + 1e-3
    xx, xy, yy, determinant = footprints.covariance.unbind(-1)
    x, y = footprints.xy.unbind(-1)
    reach = radius * yy.sqrt()
    first_row, row_count = _span(y - reach, y + reach, size, rows)
    owner, rank = _expand(row_count)
    row = first_row[owner] + rank

    # In a row of tiles the ellipse's x is extreme at its own tip, or at the edge nearest to that.
    top = (row * size).to(y) + 0.5 - y[owner]
    bottom = top + (size - 1)
    tip = (radius * xy / xx.sqrt())[owner]
    limit, shear = reach[owner], (xy / yy)[owner]
    half_squared, yy_row = (determinant / yy)[owner], yy[owner]
    radius_squared = radius.square()[owner]

    def edge(sign: float) -> Float[Tensor, " r"]:
        dy = torch.minimum(torch.maximum(sign * tip, top), bottom)
        dy = torch.minimum(torch.maximum(dy, -limit), limit)
        half = (half_squared * (radius_squared - dy * dy / yy_row).clamp_min(0)).sqrt()
        return x[owner] + shear * dy + sign * half

    first_column, column_count = _span(edge(-1.0), edge(1.0), size, columns)
    pair, rank = _expand(column_count)
    tile = row[pair] * columns + first_column[pair] + rank
    order = stable_argsort(tile, columns * rows)
    counts = torch.bincount(tile, minlength=columns * rows)
    starts = torch.cat((torch.zeros(1, dtype=torch.long), counts.cumsum(0)))
    members = owner[pair]
    return Bins(
        members=members[order],
        starts=starts,
        slots=torch.cat((order, order.new_tensor([len(order)]))),
        counts=torch.bincount(members, minlength=len(x)),
        size=size,
        columns=columns,
        rows=rows,
    )


def stable_argsort(keys: Int[Tensor, " p"], bound: int) -> Int[Tensor, " p"]:
    """Stable argsort of integers in [0, bound): a radix sort where the keys are narrow."""
    if bound <= 1 << 16:
        return torch.from_numpy(np.argsort(keys.numpy().astype(np.uint16), kind="stable"))
    return torch.argsort(keys.int(), stable=True)


def depth_order(depth: Float[Tensor, " m"]) -> Int[Tensor, " m"]:
    """Front to back; equal depths keep file order. Positive floats sort like their bits."""
    bits = {torch.float32: torch.int32, torch.float64: torch.int64}[depth.dtype]
    return torch.argsort(depth.detach().view(bits), stable=True)
