"""Blending in torch, forward and backward, in batches.

`m` Gaussians with `d` features, `t` tiles of `q` pixels, of which a group holds `b`, with `p`
(tile, Gaussian) pairs; a batch has `k` consecutive Gaussians of each of `c` of its tiles, those
whose lists are long enough. It is small enough that the arrays of [k, c, q] elements that a step
touches stay in cache, and large enough that Python's part is small: few tiles are blended in deep
batches, many in shallow ones. Every step is one operation on a [k, c, q] block; see `reference.py`
for the equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, Backend, Blended, BlendInputs, ForwardPass
from rasterizer.tiles import Bins

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


SAVED_PAIRS = 1 << 22
"""Up to so many, what the backward pass needs of each pair (80 bytes) is saved, not made again."""
OPEN_SHARE = 0.8
"""Opaque tiles leave where fewer than this share of a batch's tiles stays: leaving copies."""


class _SavedBatch(NamedTuple):
    """A batch that was blended, and the transmittance in front of it."""

    batch: Batch
    transmittance: Float[Tensor, "c q"]


class _Saved(NamedTuple):
    """State that the backward pass needs."""

    grid: TileGrid
    groups: list[TileGroup]
    """As they were blended; empty where they are too many to save: then they are made again."""
    batches: list[list[_SavedBatch]]
    """State of each group; empty unless a gradient is wanted."""


class _TiledPicture(NamedTuple):
    """A picture in tiles, or some tiles of it."""

    features: Float[Tensor, "t d q"]
    transmittance: Float[Tensor, "t q"]
    above_half: Float[Tensor, "t q"] | None
    """How many Gaussians leave a transmittance above one half; None: not wanted."""

    @classmethod
    def empty(cls, grid: TileGrid, width: int, height: int, *, median: bool) -> _TiledPicture:
        """Nothing blended yet; no transmittance beyond the picture: there all tiles may stop."""
        like, bins = grid.monomials, grid.bins
        tiles = bins.rows * bins.columns
        transmittance = _to_tiles(like.new_ones(height, width, 1), bins).view(tiles, grid.pixels)
        features = like.new_zeros(tiles, grid.features.shape[1], grid.pixels)
        return cls(features, transmittance, torch.zeros_like(transmittance) if median else None)

    def part(self, rows: Int[Tensor, " b"] | slice) -> _TiledPicture:
        """Some of the tiles: views for a slice, copies for rows."""
        above = None if self.above_half is None else self.above_half[rows]
        return _TiledPicture(self.features[rows], self.transmittance[rows], above)

    def store(self, rows: Int[Tensor, " b"], part: _TiledPicture) -> None:
        """Write some of the tiles."""
        for each, values in zip(self, part):
            if each is not None and values is not None:
                each.index_copy_(0, rows, values)


def forward(inputs: BlendInputs, median: bool, differentiate: bool) -> ForwardPass:
    """Blended picture: see `Backend.forward`."""
    bins, width, height = inputs.bins, inputs.width, inputs.height
    grid = TileGrid(inputs)
    out = _TiledPicture.empty(grid, width, height, median=median)
    saved = _Saved(grid, [], [])
    for group in grid.groups():
        if differentiate and len(bins.members) <= SAVED_PAIRS:
            saved.groups.append(group)
        batches: list[_SavedBatch] | None = [] if differentiate else None
        _blend(group, out, batches)
        saved.batches.append(batches or [])
    index = None
    if median:
        index = _to_picture(_median_index(grid, out)[:, None], bins, width, height)[..., 0]
    picture = _to_picture(out.features, bins, width, height).contiguous()
    passed = _to_picture(out.transmittance[:, None], bins, width, height)[..., 0].contiguous()
    return ForwardPass(Blended(picture, passed, index), saved)


class _OpenTiles:
    """The tiles of a group whose lists go on and that are not opaque."""

    def __init__(self, group: TileGroup, out: _TiledPicture) -> None:
        self._group, self._out = group, out
        self._kept: Int[Tensor, " c"] | None = None
        """Ascending positions among the group's tiles; None: the first ones."""
        self.picture = out.part(group.tiles)
        """What was blended so far of each."""

    def at(self, batch: Batch, stop: float) -> Batch:
        """The batch of the open tiles. Those whose lists have ended are closed; the opaque ones
        too, if they are many."""
        kept = self._kept
        count = batch.count if kept is None else int((kept < batch.count).sum())
        self.close(count)
        if stop and batch.start and count:
            is_open = self.picture.transmittance.amax(-1) > stop
            if int(is_open.sum()) < OPEN_SHARE * count:
                self._store((~is_open).nonzero().squeeze(-1))
                rows = is_open.nonzero().squeeze(-1)
                self._kept = rows if self._kept is None else self._kept[rows]
                self.picture = self.picture.part(rows)
        return batch._replace(chosen=self._kept)

    def close(self, first: int = 0) -> None:
        """Those from the `first` on."""
        if first < len(self.picture.transmittance):
            self._store(slice(first, None))
            self.picture = self.picture.part(slice(first))
            self._kept = None if self._kept is None else self._kept[:first]

    def _store(self, rows: Int[Tensor, " c"] | slice) -> None:
        """Write what was blended into the picture."""
        part = self.picture.part(rows)
        tiles = self._group.tiles if self._kept is None else self._group.tiles[self._kept]
        self._out.store(tiles[: len(self.picture.transmittance)][rows], part)


def _blend(group: TileGroup, out: _TiledPicture, saved: list[_SavedBatch] | None) -> None:
    """Blend a group's tiles to the end of their lists, or until they are opaque."""
    tiles = _OpenTiles(group, out)
    stop = group.grid.numerics.transmittance_min
    limits = torch.finfo(out.transmittance.dtype)
    least = limits.tiny / limits.eps  # arithmetic on smaller numbers is 10 times slower
    for each in group.batches:
        batch = tiles.at(each, stop)
        features, transmittance, above_half = tiles.picture
        if not len(transmittance):
            return
        torch.threshold_(transmittance, least, 0.0)
        if saved is not None:
            saved.append(_SavedBatch(batch, transmittance.clone()))
        alpha = group.alpha(batch)
        passing = group.grid.buffer(1, *alpha.shape)
        passing[0] = transmittance
        torch.sub(1, alpha[:-1], out=passing[1:])
        multiply_up(passing)
        weight = alpha.mul_(passing)
        torch.sub(passing[-1], weight[-1], out=transmittance)
        if above_half is not None:
            above_half += (passing[1:] > 0.5).sum(0)
            above_half += transmittance > 0.5
        colors = group.features_of(batch).permute(1, 2, 0)
        features.baddbmm_(colors, weight.transpose(0, 1))
    tiles.close()


def multiply_up(rows: Float[Tensor, "k c q"]) -> None:
    """Each row times all before it, in place: log2(k) operations on half of the elements each
    (Sklansky 1960). As views of the memory: slices of slices take as long as the products."""
    count, step, first = len(rows), rows[0].numel(), rows.storage_offset()
    span = 1
    while span < count:
        whole = count // (2 * span)
        strides = (2 * span * step, step, 1)
        if whole:
            last = rows.as_strided((whole, 1, step), strides, first + (span - 1) * step)
            rows.as_strided((whole, span, step), strides, first + span * step).mul_(last)
        rest = (2 * whole + 1) * span
        if rest < count:
            rows[rest:].mul_(rows[rest - 1])
        span *= 2


def backward(
    saved: _Saved,
    transmittance: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"],
    grad_transmittance: Float[Tensor, "h w"],
) -> Float[Tensor, "m g"]:
    """Gradient by the table: see `Backend.backward`."""
    grid = saved.grid
    from_background = grad_transmittance * transmittance
    upstream = _to_tiles(torch.cat((grad_features, from_background[..., None]), -1), grid.bins)
    upstream, behind = upstream[:, :-1], upstream[:, -1]
    gradients = upstream.new_zeros(grad_features.shape[-1] + GEOMETRY, len(grid.features))
    for group, batches in zip(saved.groups or grid.groups(), saved.batches):
        rows = _blend_backward(group, batches, upstream[group.tiles], behind[group.tiles])
        gradients.index_add_(1, group.members, rows)
    return gradients[:, :-1].T


def _blend_backward(
    group: TileGroup, saved: list[_SavedBatch], upstream: Float[Tensor, "b d q"],
    behind: Float[Tensor, "b q"],
) -> Float[Tensor, "g p"]:  # fmt: skip
    """Gradients of a group's pairs. `behind` is what lies behind each pixel's last Gaussian adds
    to the loss, at first the background; it is overwritten.

    Of the exponent it is alpha_i dL/dalpha_i = gain_i - rest_i alpha_i / (1 - alpha_i), with
    gain_i = T_i alpha_i (c_i . g) and rest_i the sum of the gains behind, and of the background.
    """
    grid, least = group.grid, group.grid.numerics.gradient_min
    capped = grid.numerics.alpha_max * (1 - 4 * torch.finfo(upstream.dtype).eps)
    gradients = upstream.new_zeros(GEOMETRY + upstream.shape[1], len(group.members))
    for batch, transmittance in reversed(saved):
        alpha = group.alpha(batch)
        depth, count, pixels = alpha.shape
        # four buffers: each is used again as soon as what is in it was read
        gains = grid.buffer(1, depth + 1, count, pixels)
        passing = gains[:-1]
        torch.sub(1, alpha, out=gains[1:])
        odds = torch.div(alpha, gains[1:], out=grid.buffer(2, *alpha.shape))
        passing[0] = transmittance
        multiply_up(passing)
        weight = alpha.mul_(passing)

        unfelt = weight < least if least else None
        felt = weight if unfelt is None else weight.masked_fill(unfelt, 0)
        g = batch.select_tiles(upstream)
        from_features = torch.bmm(felt.transpose(0, 1), g.transpose(1, 2))
        batch.store(gradients[GEOMETRY:], from_features.permute(2, 1, 0))
        rests = _rests(group, batch, weight, gains, g, behind)
        grad = gains[:-1].addcmul_(rests[1:], odds, value=-1)
        if grid.capped:  # no gradient where alpha is held at its cap
            limit = capped / (1 - capped)
            torch.ops.aten.hardtanh_backward(grad, odds, -torch.inf, limit, grad_input=grad)
        if unfelt is not None:
            grad.masked_fill_(unfelt, 0)
        moments = torch.mm(grid.slopes, grad.flatten(0, 1).T).unflatten(1, (depth, count))
        batch.store(gradients[:GEOMETRY], moments)
    group.chain(gradients[:GEOMETRY])
    return gradients


def _rests(
    group: TileGroup,
    batch: Batch,
    weight: Float[Tensor, "k c q"],
    gains: Float[Tensor, "k1 c q"],
    g: Float[Tensor, "c d q"],
    behind: Float[Tensor, "b q"],
) -> Float[Tensor, "k1 c q"]:
    """Sums of what a batch's Gaussians, from each on, add to the loss, and all behind them.

    Fills `gains`; `behind` is from then on what the batch adds too.
    """
    depth, count, pixels = weight.shape
    rests = group.grid.buffer(3, *gains.shape)
    # by way of `rests`: a strided result of bmm would take 8 times longer
    value = rests[:-1].view(count, depth, pixels)
    torch.bmm(group.features_of(batch).transpose(0, 1), g, out=value)
    torch.mul(value.transpose(0, 1), weight, out=gains[:-1])
    gains[-1] = batch.select_tiles(behind)
    torch.mm(group.grid.suffix_sums(depth + 1), gains.flatten(1), out=rests.flatten(1))
    batch.store_tiles(behind, rests[0])
    return rests


def _to_picture(
    tiled: Float[Tensor, "t d q"] | Int[Tensor, "t d q"], bins: Bins, width: int, height: int
) -> Tensor:
    """Tiles to pixels [h w d]."""
    side = bins.size
    grid = tiled.view(bins.rows, bins.columns, -1, side, side).permute(0, 3, 1, 4, 2)
    return grid.reshape(bins.rows * side, bins.columns * side, -1)[:height, :width]


def _to_tiles(picture: Float[Tensor, "h w d"], bins: Bins) -> Float[Tensor, "t d q"]:
    """Pixels to tiles, zero beyond the picture."""
    side, (height, width, depth) = bins.size, picture.shape
    padded = picture.new_zeros(bins.rows * side, bins.columns * side, depth)
    padded[:height, :width] = picture
    grid = padded.view(bins.rows, side, bins.columns, side, depth).permute(0, 2, 4, 1, 3)
    return grid.reshape(bins.rows * bins.columns, depth, side * side)


def _median_index(grid: TileGrid, out: _TiledPicture) -> Int[Tensor, "t q"]:
    """The Gaussian that takes a pixel's transmittance to one half or below; -1: none."""
    assert out.above_half is not None
    starts, ends = grid.bins.starts[:-1, None], grid.bins.starts[1:, None]
    position = starts + out.above_half.long()
    hit = (out.transmittance <= 0.5) & (position < ends)
    return torch.where(hit, grid.members[position.clamp_max(len(grid.members) - 1)], -1)


def pull(inputs: BlendInputs, maps: Float[Tensor, "h w 3"]) -> Float[Tensor, "m 3"]:
    """`Backend.pull`, as the gradient by the features."""
    blended, saved = forward(inputs, False, True)
    still = torch.zeros_like(blended.transmittance)
    return backward(saved, blended.transmittance, maps, still)[:, GEOMETRY:]


BACKEND = Backend(
    name="torch",
    accepts=lambda execution, device, dtype: True,
    forward=forward,
    backward=backward,
    pull=pull,
    # fitted to forward + backward of six scenes at four tile sizes
    pair_overhead=16.0,
)
