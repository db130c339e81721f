"""Blending in torch, forward and backward, in the batches of `batches.py`.

`m` Gaussians with `d` features, `t` tiles of `q` pixels, of which a group holds `b`. Every step is
one operation on a [k, b, q] block in cache; see `composite.py` for the equations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, Backend, Blended, BlendInputs, ForwardPass
from rasterizer.blending.batches import Batch, TileGrid, TileGroup
from rasterizer.tiles import Bins

SAVED_PAIRS = 1 << 22
"""Up to so many, what the backward pass needs of each pair (80 bytes) is saved: 8 % faster."""
OPEN_SHARE = 0.8
"""Opaque tiles leave a batch where fewer than this share of its tiles stays: leaving copies."""


class _SavedBatch(NamedTuple):
    """A batch that was blended, and the transmittance in front of it."""

    batch: Batch
    transmittance: Float[Tensor, "b q"]


class _Saved(NamedTuple):
    """What the backward pass needs."""

    grid: TileGrid
    groups: list[TileGroup]
    """As they were blended; empty where they are too many to save: then they are made again."""
    batches: list[list[_SavedBatch]]
    """Of each group; empty unless a gradient is wanted."""


class _TiledPicture(NamedTuple):
    """A picture in tiles."""

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


def forward(inputs: BlendInputs, median: bool, differentiate: bool) -> ForwardPass:
    """`Backend.forward`."""
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


class Entries(NamedTuple):
    """Pixels and Gaussians that show in them; those of one pixel from front to back."""

    pixel: Int[Tensor, " e"]
    """Row by row of the picture. int32, as `member`."""
    member: Int[Tensor, " e"]
    """Row of the table."""
    alpha: Float[Tensor, " e"]


def pixel_entries(inputs: BlendInputs, least: float) -> Entries:
    """What each pixel shows with a weight above `least`. Without gradients."""
    grid, bins, width = TileGrid(inputs), inputs.bins, inputs.width
    found: list[Entries] = []

    def watch(group: TileGroup, batch: Batch, alpha: Tensor, weight: Tensor) -> None:
        shown = (weight.flatten() > least).nonzero().squeeze(-1)
        slot, q = shown // grid.pixels, shown % grid.pixels
        place = slot % batch.count
        member = batch.select(group.members, 1).flatten().index_select(0, slot)
        tile = batch.select_tiles(group.tiles).index_select(0, place)
        x = tile % bins.columns * bins.size + q % bins.size
        y = tile // bins.columns * bins.size + q // bins.size
        taken = alpha.flatten().index_select(0, shown)
        found.append(Entries((y * width + x).int(), member.int(), taken))

    out = _TiledPicture.empty(grid, width, inputs.height, median=False)
    for group in grid.groups():
        _blend(group, out, None, watch)
    if not found:
        none = torch.zeros(0, dtype=torch.int32)
        return Entries(none, none, inputs.table.new_zeros(0))
    return Entries(*(torch.cat(parts) for parts in zip(*found)))


def backward(
    saved: _Saved,
    transmittance: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"],
    grad_transmittance: Float[Tensor, "h w"],
) -> Float[Tensor, "p g"]:
    """`Backend.backward`."""
    grid, bins = saved.grid, saved.grid.bins
    from_background = grad_transmittance * transmittance
    upstream = _to_tiles(torch.cat((grad_features, from_background[..., None]), -1), bins)
    upstream, behind = upstream[:, :-1], upstream[:, -1]
    pairs = len(bins.members)
    gradients = upstream.new_zeros(pairs + 1, GEOMETRY + grad_features.shape[-1])
    # the last row takes what belongs to the empty Gaussian
    slots = torch.cat((bins.slots, bins.slots.new_tensor([pairs])))
    for group, batches in zip(saved.groups or grid.groups(), saved.batches):
        rows = _blend_backward(group, batches, upstream[group.tiles], behind[group.tiles])
        gradients.index_copy_(0, slots[group.pairs.flatten()], rows.flatten(0, 1))
    return gradients[:-1]


class _OpenTiles:
    """The tiles of a group that are not opaque, and what was blended so far."""

    def __init__(self, group: TileGroup, out: _TiledPicture) -> None:
        self.group, self.out = group, out
        self.kept: Int[Tensor, " b"] | None = None
        """Ascending positions among the group's tiles; None: all."""
        self.transmittance = out.transmittance[group.tiles]
        self.features = out.features.new_zeros(len(group.tiles), *out.features.shape[1:])
        self.above_half = (
            torch.zeros_like(self.transmittance) if out.above_half is not None else None
        )

    def store(self) -> None:
        """Write what was blended so far into the picture."""
        tiles = self.group.tiles if self.kept is None else self.group.tiles[self.kept]
        self.out.features[tiles] = self.features
        self.out.transmittance[tiles] = self.transmittance
        if self.out.above_half is not None and self.above_half is not None:
            self.out.above_half[tiles] = self.above_half

    def close_opaque(self, count: int, stop: float) -> int:
        """Of the first `count` tiles drop the opaque ones, if there are many; how many remain.

        The tiles after them, whose lists have ended, leave with them.
        """
        is_open = self.transmittance[:count].amax(-1) > stop
        remaining = int(is_open.sum())
        if remaining >= OPEN_SHARE * count:
            return count
        self.store()
        rows = is_open.nonzero().squeeze(-1)
        self.kept = rows if self.kept is None else self.kept[rows]
        self.transmittance, self.features = self.transmittance[rows], self.features[rows]
        if self.above_half is not None:
            self.above_half = self.above_half[rows]
        return remaining


Watch = Callable[[TileGroup, Batch, Tensor, Tensor], None]
"""Is shown each batch that was blended: its alphas and its weights, [k b q] each."""


def _blend(
    group: TileGroup,
    out: _TiledPicture,
    saved: list[_SavedBatch] | None,
    watch: Watch | None = None,
) -> None:
    """Blend a group's tiles to the end of their lists, or until they are opaque."""
    tiles = _OpenTiles(group, out)
    stop = group.grid.numerics.transmittance_min
    limits = torch.finfo(tiles.transmittance.dtype)
    least = limits.tiny / limits.eps  # arithmetic on smaller numbers is 10 times slower
    for start, count in zip(group.first, group.active):
        if tiles.kept is not None:
            count = int((tiles.kept < count).sum())
        if count and stop and start:
            count = tiles.close_opaque(count, stop)
        if not count:
            break
        batch = Batch(start, count, None if tiles.kept is None else tiles.kept[:count])
        transmittance, features = tiles.transmittance[:count], tiles.features[:count]
        torch.threshold_(transmittance, least, 0.0)
        if saved is not None:
            saved.append(_SavedBatch(batch, transmittance.clone()))
        alpha = group.alpha(batch)
        unweighted = None if watch is None else alpha.clone()
        for weight in alpha.unbind(0):
            weight.mul_(transmittance)
            transmittance.sub_(weight)
            if tiles.above_half is not None:
                tiles.above_half[:count].add_(transmittance > 0.5)
        colors = batch.select(group.features, 1).permute(1, 2, 0)
        features.baddbmm_(colors, alpha.transpose(0, 1))
        if watch is not None and unweighted is not None:
            watch(group, batch, unweighted, alpha)
    tiles.store()


def _blend_backward(
    group: TileGroup, saved: list[_SavedBatch], upstream: Float[Tensor, "b d q"],
    behind: Float[Tensor, "b q"],
) -> Float[Tensor, "k n g"]:  # fmt: skip
    """Gradients of a group's pairs. `behind` is what lies behind each pixel's last Gaussian adds
    to the loss, at first the background; it is overwritten.

    Of the exponent it is alpha_i dL/dalpha_i = gain_i - rest_i alpha_i / (1 - alpha_i), with
    gain_i = T_i alpha_i (c_i . g) and rest_i the sum of the gains behind, and of the background.
    """
    grid, depth = group.grid, group.features.shape[-1]
    capped = grid.numerics.alpha_max * (1 - 4 * torch.finfo(upstream.dtype).eps)
    gradients = upstream.new_zeros(*group.members.shape, GEOMETRY + depth)
    for batch, transmittance in reversed(saved):
        alpha = group.alpha(batch)
        weight, gain, rest = (grid.buffer(number, batch.count) for number in (1, 2, 3))
        passing = transmittance.clone()
        for a, w in zip(alpha.unbind(0), weight.unbind(0)):
            torch.mul(a, passing, out=w)
            passing.sub_(w)

        g = batch.select_tiles(upstream)
        features = batch.select(group.features, 1)
        # by way of `rest`: a strided result of bmm would take 8 times longer
        value = rest.view(batch.count, grid.block, grid.pixels)
        torch.bmm(features.transpose(0, 1), g, out=value)
        torch.mul(value.transpose(0, 1), weight, out=gain)
        from_features = torch.bmm(weight.transpose(0, 1), g.transpose(1, 2)).transpose(0, 1)
        after = rest.unbind(0)
        after[-1].copy_(batch.select_tiles(behind))
        gains = gain.unbind(0)
        for i in range(len(after) - 1, 0, -1):
            torch.add(after[i], gains[i], out=after[i - 1])
        batch.store_tiles(behind, torch.add(after[0], gains[0]))

        odds = torch.div(alpha, torch.sub(1, alpha, out=weight), out=weight)
        grad = gain.addcmul_(rest, odds, value=-1)
        if grid.capped:  # no gradient where alpha is held at its cap
            torch.ops.aten.hardtanh_backward(grad, alpha, -torch.inf, capped, grad_input=grad)
        from_quadratic = (grad.flatten(0, 1) @ grid.monomials.T).view(*grad.shape[:2], 6)
        batch.store(gradients[..., :GEOMETRY], from_quadratic)
        batch.store(gradients[..., GEOMETRY:], from_features)
    group.chain(gradients)
    return gradients


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


BACKEND = Backend(
    name="torch",
    accepts=lambda execution, device, dtype: True,
    forward=forward,
    backward=backward,
    # fitted to forward + backward of six scenes at four tile sizes
    pair_overhead=16.0,
)
