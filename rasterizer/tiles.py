"""Lists of the Gaussians that touch each tile, in depth order. Nothing here has a gradient.

`m` Gaussians, `t` tiles, `p` (tile, Gaussian) pairs. Positions are pixels from the box's corner.
A Gaussian's rank is its place in the order of depth, 0 in front.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

TILE_SIZES = (4, 8, 16, 32)
"""Sides to choose from, pixels."""


@dataclass(frozen=True, eq=False)
class Bins:
    """Each tile's Gaussians, front to back."""

    members: Int[Tensor, " p"]
    """Gaussian of each pair; pairs of one tile are contiguous."""
    starts: Int[Tensor, " t1"]
    """Tile i holds members[starts[i] : starts[i + 1]]; tiles are in row-major order."""
    slots: Int[Tensor, " p"]
    """Position of each pair when pairs are grouped by rank."""
    firsts: Int[Tensor, " m"]
    """Slot at which each rank's pairs begin."""
    rank: Int[Tensor, " m"]
    """Rank of each Gaussian."""
    size: int
    """Side of a tile, pixels."""
    columns: int
    rows: int


@dataclass(frozen=True, eq=False)
class Footprints:
    """Ellipses |W (p - xy)| <= radius outside of which alpha is below the floor."""

    xy: Float[Tensor, "m 2"]
    covariance: Float[Tensor, "m 4"]
    """xx, xy, yy, and the variance of x at a given y."""
    radius: Float[Tensor, " m"]
    """In standard deviations; 0: never visible."""


@torch.no_grad()
def choose_tile_size(footprints: Footprints, width: int, height: int, pair_overhead: float) -> int:
    """The side, of TILE_SIZES, that costs least: every pair its tile's pixels, plus an overhead.

    `pair_overhead` is what a pair costs beside its pixels, in units of one pixel of one pair.
    """
    xy, variances, radius = footprints.xy.T, footprints.covariance.T[::2], footprints.radius
    x = _overlap(xy[0], variances[0], radius, width)
    y = _overlap(xy[1], variances[1], radius, height)

    def cost(size: int) -> float:
        tiles = ((x / size).add_(1) * (y / size).add_(1)).sum(dtype=torch.float64).item()
        return tiles * (size * size + pair_overhead)

    return min(TILE_SIZES, key=cost)


def _overlap(
    at: Float[Tensor, " m"], variance: Float[Tensor, " m"], radius: Float[Tensor, " m"], size: int
) -> Float[Tensor, " m"]:
    """How many of the picture's pixels along one axis each footprint covers."""
    half = variance.sqrt().mul_(radius)
    low = (at - half).clamp_(0, size)
    return half.add_(at).clamp_max_(size).sub_(low).clamp_min_(0)


def _span(
    low: Float[Tensor, " m"], high: Float[Tensor, " m"], size: int, count: int
) -> tuple[Int[Tensor, " m"], Int[Tensor, " m"]]:
    """First tile and number of tiles with a pixel center in [low, high]."""
    first = ((low + 0.5) / size - 1).ceil().clamp(0, count)
    last = ((high - 0.5) / size).floor().clamp(-1, count - 1)
    return first.long(), (last - first + 1).clamp_min(0).long()


@torch.no_grad()
def bin_tiles(
    footprints: Footprints, order: Int[Tensor, " m"], size: int, width: int, height: int
) -> Bins:
    """List the Gaussians of every tile that an ellipse touches: exact, a row of tiles at a time.

    `order` lists the Gaussians front to back; `size`, `width` and `height` are in pixels.
    """
    columns, rows = -(-width // size), -(-height // size)
    spans = _row_spans(footprints, order, size, rows)
    first_column, column_count = _span(*_reach_in_rows(spans, size), size, columns)
    pair = torch.repeat_interleave(column_count)
    ends = column_count.cumsum(0)
    first_tile = spans.row * columns + first_column - ends + column_count
    tile = first_tile.index_select(0, pair) + _indices(pair)
    by_tile = stable_argsort(tile, columns * rows)
    counts = torch.bincount(tile, minlength=columns * rows)
    members = order.index_select(0, spans.owner).index_select(0, pair)
    before = torch.cat((ends.new_zeros(1), ends))  # pairs of all spans up to one
    return Bins(
        members=members.index_select(0, by_tile),
        starts=torch.cat((counts.new_zeros(1), counts.cumsum(0))),
        slots=by_tile,
        firsts=before.index_select(0, spans.firsts),
        rank=inverse(order),
        size=size,
        columns=columns,
        rows=rows,
    )


class _RowSpans(NamedTuple):
    """Every row of tiles that an ellipse reaches, for each ellipse: `r` in all, by rank."""

    row: Int[Tensor, " r"]
    """Row among the rows of tiles."""
    owner: Int[Tensor, " r"]
    """Rank of the row's ellipse."""
    firsts: Int[Tensor, " m"]
    """Index at which each rank's spans begin."""
    ellipses: tuple[Tensor, ...]
    """x, y, xx, xy, yy, variance of x at a given y, radius and vertical reach by rank [m]."""


def _row_spans(footprints: Footprints, order: Int[Tensor, " m"], size: int, rows: int) -> _RowSpans:
    # Rounding must never lose a pair: a superset is harmless, each pixel tests its own alpha.
    radius = footprints.radius * 1.0005 + 1e-3
    fields = (*footprints.xy.unbind(-1), *footprints.covariance.unbind(-1), radius)
    x, y, xx, xy, yy, within, radius = _columns(torch.stack(fields), order)
    reach = radius * yy.sqrt()
    first_row, row_count = _span(y - reach, y + reach, size, rows)
    owner = torch.repeat_interleave(row_count)
    firsts = row_count.cumsum(0) - row_count
    row = (first_row - firsts).index_select(0, owner) + _indices(owner)
    return _RowSpans(row, owner, firsts, (x, y, xx, xy, yy, within, radius, reach))


def _reach_in_rows(spans: _RowSpans, size: int) -> tuple[Float[Tensor, " r"], Float[Tensor, " r"]]:
    """Lowest and highest x, pixels, that each ellipse has in each of its rows of tiles.

    In a row the ellipse's x is extreme at its own tip, or at the edge nearest to that.
    """
    x, y, xx, xy, yy, within, radius, reach = spans.ellipses
    tip = radius * xy / xx.sqrt()
    shapes = torch.stack((x, y, tip, reach, xy / yy, within, 1 / yy, radius.square()))
    x, y, tip, reach, shear, within, per_yy, radius_squared = _columns(shapes, spans.owner)
    top = (spans.row * size).to(y) + 0.5 - y
    bottom = top + (size - 1)

    def edge(sign: float) -> Float[Tensor, " r"]:
        dy = torch.minimum(torch.maximum(sign * tip, top), bottom)
        dy = torch.minimum(torch.maximum(dy, -reach), reach)
        half = (within * (radius_squared - dy * dy * per_yy).clamp_min(0)).sqrt()
        return x + shear * dy + sign * half

    return edge(-1.0), edge(1.0)


def _columns(values: Float[Tensor, "f n"], index: Int[Tensor, " i"]) -> Float[Tensor, "f i"]:
    """values[:, index], on all threads."""
    return values.gather(1, index.expand(len(values), -1))


def _indices(values: Int[Tensor, " n"]) -> Int[Tensor, " n"]:
    """0 to n - 1, on the device of the values."""
    return torch.arange(len(values), device=values.device)


def inverse(permutation: Int[Tensor, " n"]) -> Int[Tensor, " n"]:
    """The permutation that undoes another."""
    places = torch.empty_like(permutation)
    places[permutation] = _indices(permutation)
    return places


def stable_argsort(keys: Int[Tensor, " p"], bound: int) -> Int[Tensor, " p"]:
    """Stable argsort of integers in [0, bound): on a CPU a radix sort where the keys are narrow."""
    if bound <= 1 << 16 and keys.device.type == "cpu":
        return torch.from_numpy(np.argsort(keys.numpy().astype(np.uint16), kind="stable"))
    return torch.argsort(keys.int(), stable=True)


def depth_order(depth: Float[Tensor, " m"]) -> Int[Tensor, " m"]:
    """Indices front to back; equal depths keep file order.

    Floats above 0 sort like their bits, and those faster.
    """
    depth = depth.detach()
    if len(depth) and depth.min() <= 0:  # an orthographic camera sees what is behind it
        return torch.argsort(depth, stable=True)
    bits = {torch.float32: torch.int32, torch.float64: torch.int64}[depth.dtype]
    return torch.argsort(depth.view(bits), stable=True)
