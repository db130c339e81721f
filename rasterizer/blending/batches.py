"""The lists of a group of tiles laid out in batches, for the torch backend. Nothing here blends.

A block is up to `k` consecutive Gaussians of one tile's list; batch j holds the j-th block of every
list that is long enough. `b` tiles of `q` pixels, longest lists first; `n` blocks in all, ordered
by batch and, within a batch, by tile: batch j is the blocks first[j] : first[j] + active[j].
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import NamedTuple

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, BlendInputs

BLOCK = 16
"""Gaussians of a block; up to MAX_BLOCK where few tiles leave room."""
MAX_BLOCK = 64
ELEMENTS = 1 << 20
"""Elements of a batch: enough that Python's part is small, few enough that buffers are reused."""


class TileGrid:
    """What all tiles share: pixel monomials, tile centres, the table of Gaussians."""

    def __init__(self, inputs: BlendInputs) -> None:
        table, bins, numerics = inputs.table, inputs.bins, inputs.numerics
        side = bins.size
        local = torch.arange(side, dtype=table.dtype, device=table.device) + (0.5 - side / 2)
        y, x = (c.flatten() for c in torch.meshgrid(local, local, indexing="ij"))
        self.monomials: Float[Tensor, "6 q"] = torch.stack(
            (torch.ones_like(x), x, y, x * x, x * y, y * y)
        )
        """1, x, y, xx, xy, yy of the pixels' centres, from the tile's centre."""
        tile = torch.arange(bins.rows * bins.columns, device=table.device)
        corners = torch.stack((tile % bins.columns, tile // bins.columns)) * side
        self.centres: Float[Tensor, "2 t"] = (corners + side / 2).to(table)
        """Of all tiles: x, y, pixels from the picture's corner."""
        self.bins, self.numerics, self.pixels = bins, numerics, side * side
        # a last, empty Gaussian fills up the blocks
        empty = table.new_zeros(1, table.shape[1])
        empty[0, 5] = 2 * numerics.log_alpha_min
        padded = torch.cat((table, empty))
        self.geometry: Float[Tensor, "6 m1"] = padded[:, :GEOMETRY].T.contiguous()
        self.features: Float[Tensor, "m1 d"] = padded[:, GEOMETRY:].contiguous()
        self.members = torch.cat((bins.members, bins.members.new_tensor([len(table)])))
        """The bins' members, then the empty Gaussian."""
        self.capped = len(table) > 0 and bool(table[:, 5].max() > numerics.log_alpha_max)
        """Whether some alpha may be held at its cap."""
        self.lengths: Int[Tensor, " t"] = bins.starts.diff()
        self.occupied = int((self.lengths > 0).sum())
        fitting = ELEMENTS // (self.pixels * max(1, self.occupied))
        self.block = inputs.block or min(max(fitting, BLOCK), MAX_BLOCK)
        self.group_size = max(1, ELEMENTS // (self.block * self.pixels))
        """Largest number of tiles of a group."""
        self.buffers: list[Tensor] = []

    def groups(self) -> Iterator[TileGroup]:
        """All tiles that are not empty, as many at once as make a batch of ELEMENTS."""
        order = torch.argsort(self.lengths, descending=True, stable=True)[: self.occupied]
        if self.occupied:
            for tiles in order.split(self.group_size):
                yield TileGroup(self, tiles)

    def buffer(self, number: int, tiles: int) -> Float[Tensor, "k b q"]:
        """Memory for a batch, the same each time: new memory costs more than what is done in it."""
        shape = self.block, tiles, self.pixels
        while len(self.buffers) <= number:
            largest = self.block * min(self.group_size, self.occupied) * self.pixels
            self.buffers.append(self.monomials.new_empty(largest))
        return self.buffers[number][: prod(shape)].view(shape)


class Batch(NamedTuple):
    """One block of each of the group's first `count` tiles, or only of those in `open_tiles`."""

    start: int
    """The first of its blocks among all blocks."""
    count: int
    open_tiles: Int[Tensor, " b"] | None = None
    """Ascending positions among the group's tiles; None: 0 .. count - 1."""

    def select(self, values: Shaped[Tensor, "..."], axis: int) -> Shaped[Tensor, "..."]:
        """Its part of an array of all blocks, which are counted along `axis`."""
        if self.open_tiles is None:
            return values.narrow(axis, self.start, self.count)
        chosen = self.open_tiles + self.start
        if axis == values.ndim - 1:  # on all threads
            return values.gather(axis, chosen.expand(*values.shape[:-1], -1))
        return values.index_select(axis, chosen)

    def select_tiles(self, values: Shaped[Tensor, "t ..."]) -> Shaped[Tensor, "b ..."]:
        """Its part (a view, if it is the first tiles) of an array of all the group's tiles."""
        if self.open_tiles is None:
            return values[: self.count]
        return values.index_select(0, self.open_tiles)

    def store_tiles(self, values: Float[Tensor, "t ..."], rows: Float[Tensor, "b ..."]) -> None:
        """Write its part of an array of all the group's tiles."""
        if self.open_tiles is None:
            values[: self.count] = rows
        else:
            values[self.open_tiles] = rows

    def store(self, values: Float[Tensor, "k n ..."], rows: Float[Tensor, "k b ..."]) -> None:
        """Write its part of an array of all blocks, which are counted along the second axis."""
        if self.open_tiles is None:
            values[:, self.start : self.start + self.count] = rows
        else:
            values[:, self.open_tiles + self.start] = rows


class Whitened(NamedTuple):
    """Offset from the mean to the tile's centre, and the same in standard deviations (u, v)."""

    dx: Float[Tensor, "k n"]
    dy: Float[Tensor, "k n"]
    w0: Float[Tensor, "k n"]
    w1: Float[Tensor, "k n"]
    w2: Float[Tensor, "k n"]
    u: Float[Tensor, "k n"]
    v: Float[Tensor, "k n"]


class TileGroup:
    """Some tiles, their Gaussians in batches, and the quadratic that is each one's exponent."""

    def __init__(self, grid: TileGrid, tiles: Int[Tensor, " b"]) -> None:
        self.grid, self.tiles = grid, tiles
        block, bins = grid.block, grid.bins
        blocks = (grid.lengths[tiles] + block - 1) // block
        batch = torch.arange(int(blocks[0]), device=tiles.device)
        active = len(tiles) - torch.searchsorted(blocks.flip(0), batch, right=True)
        first = active.cumsum(0) - active
        self.active: list[int] = active.tolist()
        """Tiles of each batch: a prefix of `tiles`."""
        self.first: list[int] = first.tolist()
        batch = torch.repeat_interleave(active)
        owner = tiles[torch.arange(len(batch), device=tiles.device) - first[batch]]
        inside = torch.arange(block, device=tiles.device)[:, None]
        at = bins.starts[owner] + batch * block + inside
        self.pairs: Int[Tensor, "k n"] = torch.where(
            at < bins.starts[owner + 1], at, len(bins.members)
        )
        """Positions in the bins' members; one past the last: the empty Gaussian."""
        self.members = grid.members.index_select(0, self.pairs.flatten()).view_as(self.pairs)
        flat = self.members.flatten()
        columns = grid.geometry.gather(1, flat.expand(GEOMETRY, -1))  # on all threads
        x, y, w0, w1, w2, log_opacity = columns.view(GEOMETRY, *self.members.shape)
        centre_x, centre_y = grid.centres[:, owner]
        dx, dy = centre_x - x, centre_y - y
        u, v = w0 * dx, w1 * dx + w2 * dy
        self.whitened = Whitened(dx, dy, w0, w1, w2, u, v)
        self.quadratic: Float[Tensor, "6 k n"] = torch.stack(
            (
                log_opacity - 0.5 * (u * u + v * v), -(u * w0 + v * w1), -(v * w2),
                -0.5 * (w0 * w0 + w1 * w1), -(w1 * w2), -0.5 * (w2 * w2),
            )
        )  # fmt: skip
        """The coefficients of 1, x, y, xx, xy, yy."""
        features = grid.features.index_select(0, flat)
        self.features: Float[Tensor, "k n d"] = features.view(*self.members.shape, -1)

    def alpha(self, batch: Batch) -> Float[Tensor, "k b q"]:
        """Of a batch at every pixel, in buffer 0.

        One clamp covers the cap and the floor: exp is slow where it underflows.
        """
        numerics = self.grid.numerics
        alpha = self.grid.buffer(0, batch.count)
        quadratic = batch.select(self.quadratic, 2).reshape(6, -1)
        torch.mm(quadratic.T, self.grid.monomials, out=alpha.flatten(0, 1))
        alpha.clamp_(numerics.log_alpha_min - 1e-3, numerics.log_alpha_max).exp_()
        # threshold keeps what is greater: one ulp less, so that alpha == alpha_min stays
        return torch.threshold_(alpha, numerics.alpha_min * (1 - torch.finfo(alpha.dtype).eps), 0.0)

    def chain(self, rows: Float[Tensor, "k n g"]) -> None:
        """In place, gradients by the quadratic to those by x, y, w0, w1, w2, log opacity."""
        g1, gx, gy, gxx, gxy, gyy = (rows[..., i].clone() for i in range(GEOMETRY))
        dx, dy, w0, w1, w2, u, v = self.whitened
        gu = -(u * g1 + w0 * gx)
        gv = -(v * g1 + w1 * gx + w2 * gy)
        rows[..., 0] = -(w0 * gu + w1 * gv)
        rows[..., 1] = -(w2 * gv)
        rows[..., 2] = gu * dx - u * gx - w0 * gxx
        rows[..., 3] = gv * dx - v * gx - w1 * gxx - w2 * gxy
        rows[..., 4] = gv * dy - v * gy - w1 * gxy - w2 * gyy
        rows[..., 5] = g1
