"""Blending in torch, forward and backward, in the waves of `waves.py`.

`m` Gaussians with `d` features, `t` tiles of `q` pixels, of which a group holds `b`. Every step is
one operation on a [k, b, q] block in cache; see `composite.py` for the equations.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.batches import GEOMETRY, Blocks, Grid, Group
from rasterizer.numerics import Numerics
from rasterizer.tiles import Bins

KEPT_PAIRS = 1 << 22
"""Up to so many, what the backward pass needs of each pair (80 bytes) is kept: 8 % faster."""
PAIR_OVERHEAD = 16.0
"""What a pair costs before any pixel is looked at (list, gather, gradient row), in pixels of it:
fitted to forward + backward of six scenes at four tile sizes."""


class _Wave(NamedTuple):
    """What the backward pass needs: which blocks, and what light came in to their tiles."""

    blocks: Blocks
    transmittance: Float[Tensor, "b q"]


class Kept(NamedTuple):
    """What the backward pass needs."""

    grid: Grid
    groups: list[Group]
    """As they were blended; empty where there are too many to keep: they are made again."""
    waves: list[list[_Wave]]
    """Of each group; empty unless a gradient is wanted."""
    light: Float[Tensor, "t q"]


def forward(
    table: Float[Tensor, "m g"], bins: Bins, width: int, height: int, numerics: Numerics,
    median: bool, *, block: int | None, differentiate: bool,
) -> tuple[Tensor, Tensor, Tensor | None, Kept]:  # fmt: skip
    """Features [h w d], transmittance [h w] and crossing [h w] or None."""
    grid = Grid(table, bins, numerics, block)
    tiles = bins.rows * bins.columns
    light = table.new_ones(height, width, 1)  # none beyond the picture: there all tiles may stop
    light = _to_tiles(light, bins).view(tiles, grid.pixels)
    features = table.new_zeros(tiles, table.shape[1] - GEOMETRY, grid.pixels)
    out = _Tiles(features, light, torch.zeros_like(light) if median else None)
    saved: list[list[_Wave]] = []
    groups: list[Group] = []
    for group in grid.groups():
        if differentiate and len(bins.members) <= KEPT_PAIRS:
            groups.append(group)
        waves: list[_Wave] | None = [] if differentiate else None
        _blend(group, out, waves)
        saved.append(waves or [])
    crossing = None
    if median:
        crossing = _to_picture(_crossing(grid, out)[:, None], bins, width, height)[..., 0]
    picture = _to_picture(features, bins, width, height).contiguous()
    passed = _to_picture(light[:, None], bins, width, height)[..., 0].clone()
    return picture, passed, crossing, Kept(grid, groups, saved, light)


def backward(
    kept: Kept, grad_features: Float[Tensor, "h w d"], grad_light: Float[Tensor, "h w"]
) -> Float[Tensor, "p g"]:
    """Gradients of every (tile, Gaussian) pair, at its slot."""
    grid, bins = kept.grid, kept.grid.bins
    upstream = _to_tiles(torch.cat((grad_features, grad_light[..., None]), -1), bins)
    behind = upstream[:, -1] * kept.light
    upstream = upstream[:, :-1]
    pairs = len(bins.members)
    gradients = upstream.new_zeros(pairs + 1, GEOMETRY + grad_features.shape[-1])
    slots = torch.cat((bins.slots, bins.slots.new_tensor([pairs])))  # the last is nobody's
    for group, waves in zip(kept.groups or grid.groups(), kept.waves):
        found = _blend_backward(group, waves, upstream[group.tiles], behind[group.tiles])
        gradients.index_copy_(0, slots[group.pairs.flatten()], found.flatten(0, 1))
    return gradients[:-1]


class _Tiles(NamedTuple):
    """Pictures in tiles."""

    features: Float[Tensor, "t d q"]
    transmittance: Float[Tensor, "t q"]
    halves: Float[Tensor, "t q"] | None
    """How many Gaussians leave more than half of the light; None: not asked for."""


def _blend(group: Group, out: _Tiles, waves: list[_Wave] | None) -> None:
    """Blend a group's tiles to the end of their lists, or until they are opaque."""
    count, pixels = len(group.tiles), group.grid.pixels
    light = out.transmittance[group.tiles]
    color = out.features.new_zeros(count, out.features.shape[1], pixels)
    halves = torch.zeros_like(light) if out.halves is not None else None
    stop = group.grid.numerics.transmittance_min
    limits = torch.finfo(light.dtype)
    least = limits.tiny / limits.eps  # below, arithmetic on what nobody sees is 10 times slower
    keep: Tensor | None = None

    def store() -> None:
        tiles = group.tiles if keep is None else group.tiles[keep]
        out.features[tiles], out.transmittance[tiles] = color, light
        if out.halves is not None and halves is not None:
            out.halves[tiles] = halves

    for start, active in zip(group.first, group.active):
        if keep is not None:
            active = int((keep < active).sum())
        if not active:
            break
        if stop and start:
            open_ = light[:active].amax(-1) > stop
            remaining = int(open_.sum())
            if remaining < 0.8 * active:  # opaque tiles leave
                store()
                at = open_.nonzero().squeeze(-1)
                keep = at if keep is None else keep[at]
                light, color = light[at], color[at]
                halves = halves[at] if halves is not None else None
                active = remaining
                if not active:
                    break
        blocks = Blocks(start, active, None if keep is None else keep[:active])
        t, c = light[:active], color[:active]
        torch.threshold_(t, least, 0.0)
        if waves is not None:
            waves.append(_Wave(blocks, t.clone()))
        alpha = group.alpha(blocks)
        for weight in alpha.unbind(0):
            weight.mul_(t)
            t.sub_(weight)
            if halves is not None:
                halves[:active].add_(t > 0.5)
        c.baddbmm_(blocks.of(group.features, 1).permute(1, 2, 0), alpha.transpose(0, 1))
    store()


def _blend_backward(
    group: Group, waves: list[_Wave], upstream: Float[Tensor, "b d q"],
    behind: Float[Tensor, "b q"],
) -> Float[Tensor, "k n g"]:  # fmt: skip
    """Gradients of a group's pairs. `behind` is what lies behind each pixel's light adds to the
    loss: at first the background; it is taken over and changed.

    Of the exponent it is alpha_i dL/dalpha_i = gain_i - rest_i alpha_i / (1 - alpha_i), with
    gain_i = T_i alpha_i (c_i . g) and rest_i the sum of the gains behind, and of the background.
    """
    grid, depth = group.grid, group.features.shape[-1]
    capped = grid.numerics.alpha_max * (1 - 4 * torch.finfo(upstream.dtype).eps)
    gradients = upstream.new_zeros(*group.members.shape, GEOMETRY + depth)
    for blocks, light in reversed(waves):
        alpha = group.alpha(blocks)
        weight, gain, rest = (grid.buffer(number, blocks.count) for number in (1, 2, 3))
        light = light.clone()
        for a, w in zip(alpha.unbind(0), weight.unbind(0)):
            torch.mul(a, light, out=w)
            light.sub_(w)

        g = blocks.tiles_of(upstream)
        features = blocks.of(group.features, 1)
        # by way of `rest`: a strided result of bmm would take 8 times longer
        value = rest.view(blocks.count, grid.block, grid.pixels)
        torch.bmm(features.transpose(0, 1), g, out=value)
        torch.mul(value.transpose(0, 1), weight, out=gain)
        from_features = torch.bmm(weight.transpose(0, 1), g.transpose(1, 2)).transpose(0, 1)
        after = rest.unbind(0)
        last = blocks.tiles_of(behind)
        after[-1].copy_(last)
        gains = gain.unbind(0)
        for i in range(len(after) - 1, 0, -1):
            torch.add(after[i], gains[i], out=after[i - 1])
        last = torch.add(after[0], gains[0])
        blocks.put_tiles(behind, last)

        odds = torch.div(alpha, torch.sub(1, alpha, out=weight), out=weight)
        grad = gain.addcmul_(rest, odds, value=-1)
        if grid.capped:  # no gradient where alpha is held at its cap
            torch.ops.aten.hardtanh_backward(grad, alpha, -torch.inf, capped, grad_input=grad)
        from_quadratic = (grad.flatten(0, 1) @ grid.monomials.T).view(*grad.shape[:2], 6)
        blocks.put(gradients[..., :GEOMETRY], from_quadratic)
        blocks.put(gradients[..., GEOMETRY:], from_features)
    group.chain(gradients)
    return gradients


def _to_picture(tiled: Tensor, bins: Bins, width: int, height: int) -> Tensor:
    """[t d q] of tiles to [h w d] of pixels."""
    side = bins.size
    grid = tiled.view(bins.rows, bins.columns, -1, side, side).permute(0, 3, 1, 4, 2)
    return grid.reshape(bins.rows * side, bins.columns * side, -1)[:height, :width]


def _to_tiles(picture: Tensor, bins: Bins) -> Tensor:
    """[h w d] of pixels to [t d q] of tiles, zero beyond the picture."""
    side, (height, width, depth) = bins.size, picture.shape
    padded = picture.new_zeros(bins.rows * side, bins.columns * side, depth)
    padded[:height, :width] = picture
    grid = padded.view(bins.rows, side, bins.columns, side, depth).permute(0, 2, 4, 1, 3)
    return grid.reshape(bins.rows * bins.columns, depth, side * side)


def _crossing(grid: Grid, out: _Tiles) -> Int[Tensor, "t q"]:
    """The Gaussian that takes a pixel's light below one half."""
    assert out.halves is not None
    starts, ends = grid.bins.starts[:-1, None], grid.bins.starts[1:, None]
    rank = starts + out.halves.long()
    hit = (out.transmittance <= 0.5) & (rank < ends)
    return torch.where(hit, grid.members[rank.clamp_max(len(grid.members) - 1)], -1)
