"""Lists of tiles laid out in batches, for the torch backend. Nothing here blends.

A group of tiles has `p` (tile, Gaussian) pairs; a batch of it is `k` consecutive Gaussians of each
of its `c` tiles of `q` pixels whose lists are long enough. It is small enough that the arrays of
[k, c, q] elements that a step touches stay in cache, and large enough that Python's part is small:
few tiles are blended in deep batches, many in shallow ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, BlendInputs

BLOCK, MAX_BLOCK = 16, 64
"""Gaussians of a tile in a batch: at least, and at most."""
ELEMENTS = 1 << 20
"""Elements of a batch, of which there are four arrays. On two threads the garden at 648x420 takes
338 ms, with a quarter of them 367; smaller pictures take the same time. Smaller batches also leave
opaque tiles sooner, which the gradients there feel: 2.4e-4 and not 1.0e-4 in the training step."""


class TileGrid:
    """State of all tiles: pixel monomials, tile centers, the table of Gaussians, buffers."""

    def __init__(self, inputs: BlendInputs, elements: int = ELEMENTS) -> None:
        table, bins, numerics = inputs.table, inputs.bins, inputs.numerics
        side = bins.size
        local = torch.arange(side, dtype=table.dtype, device=table.device) + (0.5 - side / 2)
        y, x = (c.flatten() for c in torch.meshgrid(local, local, indexing="ij"))
        ones, minus = torch.ones_like(x), torch.stack((-x * x, -x * y, -y * y))
        halves = minus * minus.new_tensor((0.5, 1.0, 0.5))[:, None]
        self.monomials: Float[Tensor, "6 q"] = torch.cat((torch.stack((ones, x, y)), halves))
        """1, x, y, -xx/2, -xy, -yy/2 of the pixels' centers, from the tile's center."""
        self.slopes: Float[Tensor, "6 q"] = torch.cat((self.monomials[:3], minus))
        """The same without the halves: they leave when squares are differentiated."""
        tile = torch.arange(bins.rows * bins.columns, device=table.device)
        corners = torch.stack((tile % bins.columns, tile // bins.columns)) * side
        self.centers: Float[Tensor, "2 t"] = (corners + side / 2).to(table)
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
        self.elements = elements
        self._buffers: dict[int, Tensor] = {}
        self._sums: dict[int, Tensor] = {}

    def groups(self) -> Iterator[TileGroup]:
        """All tiles that are not empty, those with long lists first, as many as a batch holds."""
        order = torch.argsort(self.lengths, descending=True, stable=True)
        occupied = int((self.lengths > 0).sum())
        if occupied:
            for tiles in order[:occupied].split(self._fitting(BLOCK)):
                yield TileGroup(self, tiles)

    def _fitting(self, count: int) -> int:
        """How many times `count` pixels of all tiles make a batch; at least 1."""
        return max(1, self.elements // (count * self.pixels))

    def depth(self, tiles: int) -> int:
        """Gaussians of each tile in a batch of so many tiles."""
        return min(max(BLOCK, self._fitting(tiles)), MAX_BLOCK)

    def buffer(self, number: int, *shape: int) -> Float[Tensor, "..."]:
        """Memory for a batch, the same each time: new memory costs more than what is done in it."""
        size = torch.Size(shape).numel()
        if number not in self._buffers or self._buffers[number].numel() < size:
            self._buffers[number] = self.monomials.new_empty(max(size, self.elements))
        return self._buffers[number][:size].view(shape)

    def suffix_sums(self, count: int) -> Float[Tensor, "k k"]:
        """The matrix whose product with `count` rows is the sum of each and of those after it."""
        if count not in self._sums:
            self._sums[count] = self.monomials.new_ones(count, count).triu()
        return self._sums[count]


class Batch(NamedTuple):
    """Some places of the lists of a group's first `count` tiles, or only of those in `chosen`."""

    start: int
    """First place in the lists."""
    depth: int
    count: int
    offset: int
    """The first of its pairs among the group's: row by row of [depth, count]."""
    chosen: Int[Tensor, " c"] | None = None
    """Ascending positions among the group's tiles; None: 0 .. count - 1."""

    def select(self, values: Shaped[Tensor, "... p"]) -> Shaped[Tensor, "... kc"]:
        """Its part of an array of the group's pairs; a view where no tiles are chosen."""
        part = values.narrow(-1, self.offset, self.depth * self.count)
        if self.chosen is None:
            return part
        return part.unflatten(-1, (-1, self.count)).index_select(-1, self.chosen).flatten(-2)

    def store(self, values: Float[Tensor, "f p"], part: Float[Tensor, "f k c"]) -> None:
        """Write its part of an array of the group's pairs."""
        there = values.narrow(-1, self.offset, self.depth * self.count)
        there = there.unflatten(-1, (-1, self.count))
        if self.chosen is None:
            there.copy_(part)
        else:
            there.index_copy_(-1, self.chosen, part)

    def select_tiles(self, values: Shaped[Tensor, "t ..."]) -> Shaped[Tensor, "c ..."]:
        """Its part of an array of the group's tiles; a view where no tiles are chosen."""
        return values[: self.count] if self.chosen is None else values.index_select(0, self.chosen)

    def store_tiles(self, values: Float[Tensor, "t ..."], part: Float[Tensor, "c ..."]) -> None:
        """Write its part of an array of the group's tiles."""
        if self.chosen is None:
            values[: self.count] = part
        else:
            values.index_copy_(0, self.chosen, part)


class Whitened(NamedTuple):
    """Means from the tile's center (dx, dy), the same in standard deviations (u), and w0 to w2."""

    dx: Float[Tensor, " p"]
    dy: Float[Tensor, " p"]
    u: Float[Tensor, "2 p"]
    w01: Float[Tensor, "2 p"]
    w2: Float[Tensor, " p"]


class TileGroup:
    """Some tiles, their pairs in batches, and the quadratic that is each pair's exponent."""

    def __init__(self, grid: TileGrid, tiles: Int[Tensor, " t"]) -> None:
        self.grid, self.tiles = grid, tiles
        self.lengths: list[int] = grid.lengths.index_select(0, tiles).tolist()
        self.batches = self._batches()
        members, owner = self._pairs()
        self.members: Int[Tensor, " p"] = members
        columns = grid.geometry.gather(1, members.expand(GEOMETRY, -1))  # on all threads
        columns[:2] -= grid.centers.gather(1, owner.expand(2, -1))
        dx, dy, w01, w2, log_opacity = columns[0], columns[1], columns[2:4], columns[4], columns[5]
        u = w01 * dx
        u[1].addcmul_(w2, dy)
        self.whitened = Whitened(dx, dy, u, w01, w2)
        quadratic = torch.empty_like(columns)
        constant, linear, _, square, mixed, _ = quadratic
        torch.mul(u, u, out=quadratic[1:3])
        torch.add(linear, quadratic[2], out=constant).mul_(-0.5).add_(log_opacity)
        torch.mul(u, w01, out=quadratic[1:3])
        linear.add_(quadratic[2])
        torch.mul(u[1], w2, out=quadratic[2])
        torch.mul(w01, w01, out=quadratic[3:5])
        square.add_(mixed)
        torch.mul(columns[3:5], w2, out=quadratic[4:6])  # w1 w2 and w2 w2
        self.quadratic: Float[Tensor, "6 p"] = quadratic
        """The coefficients of the grid's monomials."""
        self.features: Float[Tensor, "p d"] = grid.features.index_select(0, members)

    def _batches(self) -> list[Batch]:
        """To the end of the longest list."""
        found, start, offset, count = [], 0, 0, len(self.lengths)
        while start < self.lengths[0]:
            while self.lengths[count - 1] <= start:
                count -= 1
            depth = min(self.grid.depth(count), self.lengths[0] - start)
            found.append(Batch(start, depth, count, offset))
            start, offset = start + depth, offset + depth * count
        return found

    def _pairs(self) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
        """Gaussian and tile of every pair; where a list has ended, the empty Gaussian."""
        grid, tiles = self.grid, self.tiles
        starts = grid.bins.starts.index_select(0, tiles)
        lengths = grid.lengths.index_select(0, tiles)
        places = torch.arange(self.lengths[0], device=tiles.device)[:, None]
        positions, owners = [], []
        for start, depth, count, *_ in self.batches:
            inside = places[start : start + depth]
            at = inside + starts[:count]
            if self.lengths[count - 1] < start + depth:
                at.masked_fill_(inside >= lengths[:count], len(grid.members) - 1)
            positions.append(at.flatten())
            owners.append(tiles[:count].expand(depth, -1).flatten())
        return grid.members.index_select(0, torch.cat(positions)), torch.cat(owners)

    def alpha(self, batch: Batch) -> Float[Tensor, "k c q"]:
        """Alpha of a batch at every pixel, in buffer 0.

        One clamp covers the cap and the floor: exp is slow where it underflows.
        """
        grid, numerics = self.grid, self.grid.numerics
        quadratic = batch.select(self.quadratic)
        alpha = grid.buffer(0, quadratic.shape[1], grid.pixels)
        torch.mm(quadratic.T, grid.monomials, out=alpha)
        alpha.clamp_(numerics.log_alpha_min - 1e-3, numerics.log_alpha_max).exp_()
        # threshold keeps what is greater: one ulp less, so that alpha == alpha_min stays
        torch.threshold_(alpha, numerics.alpha_min * (1 - torch.finfo(alpha.dtype).eps), 0.0)
        return alpha.view(batch.depth, -1, grid.pixels)

    def features_of(self, batch: Batch) -> Float[Tensor, "k c d"]:
        """Features of a batch's Gaussians."""
        _, depth, count, offset, chosen = batch
        part = self.features[offset : offset + depth * count].unflatten(0, (depth, count))
        return part if chosen is None else part.index_select(1, chosen)

    def chain(self, moments: Float[Tensor, "6 p"]) -> None:
        """In place, gradients by the quadratic to those by x, y, w0, w1, w2, log opacity.

        `moments` are sums over pixels of the gradient by the exponent times the grid's `slopes`.
        """
        dx, dy, u, w01, w2 = self.whitened
        g1, gx, gy, gxx, gxy, gyy = moments
        by_u = (w01 * gx).addcmul_(u, g1, value=-1)
        by_u[1].addcmul_(w2, gy)
        by_w2 = (by_u[1] * dy).addcmul_(u[1], gy).addcmul_(w01[1], gxy).addcmul_(w2, gyy)
        by_w01 = (by_u * dx).addcmul_(u, gx).addcmul_(w01, gxx)
        by_w01[1].addcmul_(w2, gxy)
        moments[5] = g1
        torch.mul(by_u[1], w2, out=moments[1])
        by_u.mul_(w01)
        torch.add(by_u[0], by_u[1], out=moments[0])
        moments[2:4] = by_w01
        moments[4] = by_w2
