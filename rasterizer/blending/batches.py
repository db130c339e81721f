"""Lists of tiles laid out as waves: the j-th block of every list at once. Nothing here blends.

`b` tiles of `q` pixels, longest lists first; `k` Gaussians a block; `n` blocks in all, ordered by
wave and, within a wave, by tile. Wave j takes the blocks first[j] : first[j] + active[j].
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.numerics import Numerics
from rasterizer.tiles import Bins

BLOCK = 16
"""Gaussians of a tile blended per wave; up to MAX_BLOCK where few tiles leave room."""
MAX_BLOCK = 64
ELEMENTS = 1 << 20
"""Elements of a wave: enough that Python's part is small, few enough that buffers are reused."""
GEOMETRY = 6
"""Columns of the table before the features: x, y, w0, w1, w2, log opacity."""


class Grid:
    """What all tiles share: pixel monomials, tile centres, the table of Gaussians."""

    def __init__(
        self, table: Float[Tensor, "m g"], bins: Bins, numerics: Numerics, block: int | None
    ) -> None:
        side = bins.size
        local = torch.arange(side, dtype=table.dtype) + (0.5 - side / 2)
        y, x = (c.flatten() for c in torch.meshgrid(local, local, indexing="ij"))
        self.monomials = torch.stack((torch.ones_like(x), x, y, x * x, x * y, y * y))
        tile = torch.arange(bins.rows * bins.columns)
        self.centres = (
            torch.stack((tile % bins.columns, tile // bins.columns)) * side + side / 2
        ).to(table)
        self.bins, self.numerics, self.pixels = bins, numerics, side * side
        # a last, empty Gaussian fills up the blocks
        empty = table.new_zeros(1, table.shape[1])
        empty[0, 5] = 2 * numerics.log_alpha_min
        padded = torch.cat((table.detach(), empty))
        self.geometry = padded[:, :GEOMETRY].T.contiguous()
        self.features = padded[:, GEOMETRY:].contiguous()
        self.members = torch.cat((bins.members, bins.members.new_tensor([len(table)])))
        self.capped = len(table) > 0 and bool(table[:, 5].max() > numerics.log_alpha_max)
        self.lengths = bins.starts.diff()
        self.occupied = int((self.lengths > 0).sum())
        fitting = ELEMENTS // (self.pixels * max(1, self.occupied))
        self.block = block or min(max(fitting, BLOCK), MAX_BLOCK)
        self.together = max(1, ELEMENTS // (self.block * self.pixels))
        """Tiles of a group."""
        self.buffers: list[Tensor] = []

    def groups(self) -> Iterator[Group]:
        """All tiles that are not empty, as many at once as make a wave of ELEMENTS."""
        order = torch.argsort(self.lengths, descending=True, stable=True)[: self.occupied]
        if self.occupied:
            for tiles in order.split(self.together):
                yield Group(self, tiles)

    def buffer(self, number: int, tiles: int) -> Float[Tensor, "k b q"]:
        """Memory for a wave, the same each time: new memory costs more than what is done in it."""
        shape = self.block, tiles, self.pixels
        while len(self.buffers) <= number:
            largest = self.block * min(self.together, self.occupied) * self.pixels
            self.buffers.append(self.monomials.new_empty(largest))
        return self.buffers[number][: prod(shape)].view(shape)


class Blocks(NamedTuple):
    """Those of one wave: of its first `count` tiles, or only of those that `keep` lists."""

    start: int
    count: int
    keep: Int[Tensor, " b"] | None = None
    """Ascending positions among the group's tiles; None: 0 .. count - 1."""

    def of(self, values: Tensor, axis: int) -> Tensor:
        """Their part of an array of all blocks."""
        if self.keep is None:
            return values.narrow(axis, self.start, self.count)
        chosen = self.keep + self.start
        if axis == values.ndim - 1:  # on all threads
            return values.gather(axis, chosen.expand(*values.shape[:-1], -1))
        return values.index_select(axis, chosen)

    def tiles_of(self, values: Tensor) -> Tensor:
        """Their part (a view, if it is the first tiles) of an array of all tiles."""
        return values[: self.count] if self.keep is None else values.index_select(0, self.keep)

    def put_tiles(self, values: Tensor, rows: Tensor) -> None:
        """Store into an array of all tiles."""
        if self.keep is None:
            values[: self.count] = rows
        else:
            values[self.keep] = rows

    def put(self, values: Tensor, rows: Tensor) -> None:
        """Store into an array of all blocks, second axis."""
        if self.keep is None:
            values[:, self.start : self.start + self.count] = rows
        else:
            values[:, self.keep + self.start] = rows


class Whitened(NamedTuple):
    """Offset from the mean to the tile's centre, and the same in standard deviations (u, v)."""

    dx: Float[Tensor, "k n"]
    dy: Float[Tensor, "k n"]
    w0: Float[Tensor, "k n"]
    w1: Float[Tensor, "k n"]
    w2: Float[Tensor, "k n"]
    u: Float[Tensor, "k n"]
    v: Float[Tensor, "k n"]


class Group:
    """Some tiles, their Gaussians in waves, and the quadratic that is each one's exponent."""

    def __init__(self, grid: Grid, tiles: Int[Tensor, " b"]) -> None:
        self.grid, self.tiles = grid, tiles
        block, bins = grid.block, grid.bins
        blocks = (grid.lengths[tiles] + block - 1) // block
        wave = torch.arange(int(blocks[0]))
        active = len(tiles) - torch.searchsorted(blocks.flip(0), wave, right=True)
        first = active.cumsum(0) - active
        self.active: list[int] = active.tolist()
        """Tiles of each wave: a prefix of `tiles`."""
        self.first: list[int] = first.tolist()
        wave = torch.repeat_interleave(active)
        owner = tiles[torch.arange(len(wave)) - first[wave]]
        at = bins.starts[owner] + wave * block + torch.arange(block)[:, None]
        self.pairs = torch.where(at < bins.starts[owner + 1], at, len(bins.members))
        """Int[k n]: positions in the bins' members; one past the last: nobody."""
        self.members = grid.members.index_select(0, self.pairs.flatten()).view_as(self.pairs)
        flat = self.members.flatten()
        columns = grid.geometry.gather(1, flat.expand(GEOMETRY, -1))  # on all threads
        x, y, w0, w1, w2, log_opacity = columns.view(GEOMETRY, *self.members.shape)
        centre_x, centre_y = grid.centres[:, owner]
        dx, dy = centre_x - x, centre_y - y
        u, v = w0 * dx, w1 * dx + w2 * dy
        self.white = Whitened(dx, dy, w0, w1, w2, u, v)
        self.quadratic = torch.stack(
            (
                log_opacity - 0.5 * (u * u + v * v), -(u * w0 + v * w1), -(v * w2),
                -0.5 * (w0 * w0 + w1 * w1), -(w1 * w2), -0.5 * (w2 * w2),
            )
        )  # fmt: skip
        """Float[6 k n]: the coefficients of 1, x, y, xx, xy, yy."""
        features = grid.features.index_select(0, flat)
        self.features = features.view(*self.members.shape, -1)
        """Float[k n d]"""

    def alpha(self, blocks: Blocks) -> Float[Tensor, "k b q"]:
        """At every pixel, in buffer 0. One clamp covers cap and floor: exp is slow on underflow."""
        numerics = self.grid.numerics
        alpha = self.grid.buffer(0, blocks.count)
        quadratic = blocks.of(self.quadratic, 2).reshape(6, -1)
        torch.mm(quadratic.T, self.grid.monomials, out=alpha.flatten(0, 1))
        alpha.clamp_(numerics.log_alpha_min - 1e-3, numerics.log_alpha_max).exp_()
        # threshold keeps what is greater: step one ulp down so that alpha == alpha_min is kept
        return torch.threshold_(alpha, numerics.alpha_min * (1 - torch.finfo(alpha.dtype).eps), 0.0)

    def chain(self, rows: Float[Tensor, "k n g"]) -> None:
        """In place: from those of the quadratic to those of x, y, w0, w1, w2, log opacity."""
        g1, gx, gy, gxx, gxy, gyy = (rows[..., i].clone() for i in range(GEOMETRY))
        dx, dy, w0, w1, w2, u, v = self.white
        gu = -(u * g1 + w0 * gx)
        gv = -(v * g1 + w1 * gx + w2 * gy)
        rows[..., 0] = -(w0 * gu + w1 * gv)
        rows[..., 1] = -(w2 * gv)
        rows[..., 2] = gu * dx - u * gx - w0 * gxx
        rows[..., 3] = gv * dx - v * gx - w1 * gxx - w2 * gxy
        rows[..., 4] = gv * dy - v * gy - w1 * gxy - w2 * gyy
        rows[..., 5] = g1
