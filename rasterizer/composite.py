"""Front-to-back blending of tiles, forward and backward: the only autograd.Function.

`m` Gaussians with `d` features; `t` tiles of `q` pixels. A wavefront is the j-th block of `k`
Gaussians of `b` tiles at once: every step is one operation on a [k, b, q] block in cache. Per
pixel, front to back,

    alpha_i = min(opacity_i exp(-|W_i (p - xy_i)|^2 / 2), alpha_max), 0 below alpha_min
    color   = sum_i T_i alpha_i c_i,   T_{i+1} = T_i (1 - alpha_i).

A tile leaves the front once less than transmittance_min passes each of its pixels: what is left
out is at most that much of a colour. The exponent, log-opacity included, is a quadratic in pixel
coordinates local to the tile: one [k b, 6] @ [6, q] product.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.numerics import Numerics
from rasterizer.tiles import Bins

BLOCK = 16
"""Gaussians of a tile blended per wavefront."""
ELEMENTS = 1 << 18
"""Elements of a wavefront block: a few such buffers stay in the cache of two cores."""
GEOMETRY = 6
"""Columns of the table before the features: x, y, w0, w1, w2, log opacity."""


class Composite(NamedTuple):
    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    crossing: Int[Tensor, "h w"]
    """Gaussian at which the transmittance falls to one half; -1: none, or not asked for."""


def composite(
    table: Float[Tensor, "m g"], bins: Bins, width: int, height: int,
    numerics: Numerics, median: bool = False,
) -> Composite:  # fmt: skip
    """Blend Gaussians (rows: x, y, w0, w1, w2, log opacity, features...) over their tiles."""
    return Composite(*_Blend.apply(table, bins, width, height, numerics, median))


class _Wave(NamedTuple):
    """What the backward pass needs of a block: its tiles, where in their lists, what came in."""

    tiles: Int[Tensor, " b"]
    depth: int
    transmittance: Float[Tensor, "b q"]


class _Grid:
    """The fixed parts of a blending pass: pixel monomials, tile corners, tile lists."""

    def __init__(self, table: Tensor, bins: Bins, numerics: Numerics) -> None:
        side = bins.size
        local = torch.arange(side, dtype=table.dtype) + (0.5 - side / 2)
        y, x = (c.flatten() for c in torch.meshgrid(local, local, indexing="ij"))
        self.monomials = torch.stack((torch.ones_like(x), x, y, x * x, x * y, y * y))
        tile = torch.arange(bins.rows * bins.columns)
        centre = torch.stack((tile % bins.columns, tile // bins.columns), -1) * side + side / 2
        self.centres = centre.to(table.dtype)
        self.numerics = numerics
        self.pixels = side * side
        # a last, empty row stands for the missing Gaussians of tiles shorter than the block
        empty = table.new_zeros(1, table.shape[1])
        empty[0, 5] = 2 * numerics.log_alpha_min
        self.table = torch.cat((table.detach(), empty))
        self.members = torch.cat((bins.members, bins.members.new_tensor([table.shape[0]])))
        self.starts, self.ends = bins.starts[:-1], bins.starts[1:]
        opacity_cap = table.shape[0] > 0 and table[:, 5].max() > numerics.log_alpha_max
        self.capped = bool(opacity_cap)

    def pairs(self, tiles: Int[Tensor, " b"], depth: int) -> Int[Tensor, "k b"]:
        """Positions in `members` of the block; the last position where a list has ended."""
        at = self.starts[tiles] + (depth + torch.arange(BLOCK))[:, None]
        return torch.where(at < self.ends[tiles], at, self.members.shape[0] - 1)

    def whitened(self, rows: Float[Tensor, "k b g"], tiles: Int[Tensor, " b"]) -> _Whitened:
        dx, dy = (self.centres[tiles] - rows[..., :2]).unbind(-1)
        w0, w1, w2 = rows[..., 2], rows[..., 3], rows[..., 4]
        return _Whitened(dx, dy, w0, w1, w2, w0 * dx, w1 * dx + w2 * dy)

    def alpha(
        self, rows: Float[Tensor, "k b g"], white: _Whitened
    ) -> tuple[Float[Tensor, "k b q"], Float[Tensor, "k b q"]]:
        """(exponent, alpha): one clamp covers the cap and the floor (exp is slow on denormals)."""
        _, _, w0, w1, w2, u, v = white
        quadratic = (
            rows[..., 5] - 0.5 * (u * u + v * v), -(u * w0 + v * w1), -(v * w2),
            -0.5 * (w0 * w0 + w1 * w1), -(w1 * w2), -0.5 * (w2 * w2),
        )  # fmt: skip
        low, high = self.numerics.log_alpha_min, self.numerics.log_alpha_max
        coefficients = torch.stack(quadratic, -1)
        exponent = (coefficients.flatten(0, 1) @ self.monomials).view(*rows.shape[:2], self.pixels)
        alpha = exponent.clamp(low - 1e-3, high).exp_()
        # threshold keeps what is greater: step one ulp down so that alpha == alpha_min is kept
        return exponent, torch.threshold_(alpha, self.numerics.alpha_min * (1 - 1e-7), 0.0)


class _Whitened(NamedTuple):
    """Offset from the mean to the tile's centre, and the same in standard deviations (u, v)."""

    dx: Tensor
    dy: Tensor
    w0: Tensor
    w1: Tensor
    w2: Tensor
    u: Tensor
    v: Tensor


def _groups(bins: Bins, pixels: int) -> list[Int[Tensor, " b"]]:
    """Tiles that are not empty, longest first, in groups whose wavefronts fill one block."""
    lengths = bins.starts.diff()
    order = torch.argsort(lengths, descending=True, stable=True)
    order = order[: int((lengths > 0).sum())]
    return list(order.split(max(1, ELEMENTS // (BLOCK * pixels)))) if len(order) else []


def _blend_group(
    grid: _Grid, tiles: Int[Tensor, " b"], features: Tensor, through: Tensor,
    halves: Tensor | None, waves: list[_Wave] | None,
) -> None:  # fmt: skip
    """Blend some tiles to the end of their lists, into features [t d q] and through [t q]."""
    lengths = (grid.ends - grid.starts)[tiles]
    color = features.new_zeros(len(tiles), features.shape[1], grid.pixels)
    transmittance = through.new_ones(len(tiles), grid.pixels)
    above_half = torch.zeros_like(transmittance) if halves is not None else None
    stop = grid.numerics.transmittance_min
    depth, active = 0, len(tiles)

    def store() -> None:
        features[tiles], through[tiles] = color, transmittance
        if halves is not None and above_half is not None:
            halves[tiles] = above_half

    while active:
        tiles_now, t, c = tiles[:active], transmittance[:active], color[:active]
        if waves is not None:
            waves.append(_Wave(tiles_now, depth, t.clone()))
        rows = grid.table[grid.members[grid.pairs(tiles_now, depth)]]
        _, alpha = grid.alpha(rows, grid.whitened(rows, tiles_now))
        passed = 1 - alpha
        for i in range(BLOCK):
            alpha[i].mul_(t)
            t.mul_(passed[i])
            if above_half is not None:
                above_half[:active].add_(t > 0.5)
        block = rows[..., GEOMETRY:].permute(1, 2, 0)
        c.baddbmm_(block, alpha.transpose(0, 1))
        depth += BLOCK
        active = int((lengths > depth).sum())
        if active and stop:
            open_ = t[:active].amax(-1) > stop
            if int(open_.sum()) < 0.8 * active:  # opaque tiles leave the front
                store()
                keep = open_.nonzero().squeeze(-1)
                tiles, lengths = tiles[keep], lengths[keep]
                color, transmittance = color[keep], transmittance[keep]
                above_half = above_half[keep] if above_half is not None else None
                active = len(keep)
    store()


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


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any,
        table: Tensor,
        bins: Bins,
        width: int,
        height: int,
        numerics: Numerics,
        median: bool,
    ) -> tuple[Tensor, Tensor, Tensor]:
        grid = _Grid(table, bins, numerics)
        tile_count, depth = bins.rows * bins.columns, table.shape[1] - GEOMETRY
        features = table.new_zeros(tile_count, depth, grid.pixels)
        through = table.new_ones(tile_count, grid.pixels)
        halves = table.new_zeros(tile_count, grid.pixels) if median else None
        waves: list[_Wave] | None = [] if ctx.needs_input_grad[0] else None
        for tiles in _groups(bins, grid.pixels):
            _blend_group(grid, tiles, features, through, halves, waves)
        crossing = torch.full((height, width), -1)
        if halves is not None:
            rank = grid.starts[:, None] + halves.long()
            hit = (through <= 0.5) & (rank < grid.ends[:, None])
            who = torch.where(hit, grid.members[rank.clamp_max(len(bins.members))], -1)
            crossing = _to_picture(who[:, None], bins, width, height)[..., 0].contiguous()
        ctx.grid, ctx.bins, ctx.waves, ctx.through = grid, bins, waves, through
        ctx.mark_non_differentiable(crossing)
        picture = _to_picture(features, bins, width, height).contiguous()
        passed = _to_picture(through[:, None], bins, width, height)[..., 0].contiguous()
        return picture, passed, crossing

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(  # type: ignore[override]
        ctx: Any, grad_features: Tensor, grad_through: Tensor, _: Any
    ) -> tuple[Any, ...]:
        grid, bins = ctx.grid, ctx.bins
        if not len(bins.counts):
            return torch.zeros_like(grid.table[:-1]), None, None, None, None, None
        upstream = _to_tiles(torch.cat((grad_features, grad_through[..., None]), -1), bins)
        # what all that lies behind the current Gaussian adds to the loss: at first the background
        behind = upstream[:, -1] * ctx.through
        upstream = upstream[:, :-1].contiguous()
        gradients = grid.table.new_zeros(len(bins.members) + 1, grid.table.shape[1])
        for wave in reversed(ctx.waves):
            _backward_wave(grid, wave, upstream[wave.tiles], behind, bins.slots, gradients)
        summed = torch.segment_reduce(gradients[:-1], "sum", lengths=bins.counts)
        return summed, None, None, None, None, None


def _backward_wave(
    grid: _Grid, wave: _Wave, upstream: Float[Tensor, "b d q"], behind: Float[Tensor, "t q"],
    slots: Int[Tensor, " p1"], gradients: Float[Tensor, "p1 g"],
) -> None:  # fmt: skip
    """Gradients of one block's pairs into their slots; `behind` is taken over and handed on.

    dL/dalpha_i = T_i (c_i . g) - (sum_j>i T_j alpha_j (c_j . g) + T_end g_T) / (1 - alpha_i)
    """
    pairs = grid.pairs(wave.tiles, wave.depth)
    rows = grid.table[grid.members[pairs]]
    white = grid.whitened(rows, wave.tiles)
    exponent, alpha = grid.alpha(rows, white)
    passed = 1 - alpha

    reaching = alpha.new_empty(BLOCK + 1, *wave.transmittance.shape)
    reaching[0] = wave.transmittance
    for i in range(BLOCK):
        torch.mul(reaching[i], passed[i], out=reaching[i + 1])
    reaching = reaching[:-1]
    weight = alpha * reaching

    value = torch.bmm(rows[..., GEOMETRY:].transpose(0, 1), upstream).transpose(0, 1).contiguous()
    grad_features = torch.bmm(weight.transpose(0, 1), upstream.transpose(1, 2)).transpose(0, 1)
    gain = weight.mul_(value)
    rest = alpha.new_empty(BLOCK + 1, *wave.transmittance.shape)
    rest[BLOCK] = behind[wave.tiles]
    for i in reversed(range(BLOCK)):
        torch.add(rest[i + 1], gain[i], out=rest[i])
    behind[wave.tiles] = rest[0]

    grad = value.mul_(reaching).addcdiv_(rest[1:], passed, value=-1).mul_(alpha)
    if grid.capped:  # no gradient where alpha is held at its cap
        high = grid.numerics.log_alpha_max
        grad = torch.ops.aten.hardtanh_backward(grad, exponent, -torch.inf, high)
    grad_quadratic = (grad.flatten(0, 1) @ grid.monomials.T).view(*rows.shape[:2], 6)
    geometry = _quadratic_backward(grad_quadratic, white)
    gradients[slots[pairs].flatten()] = torch.cat((geometry, grad_features), -1).flatten(0, 1)


def _quadratic_backward(grad: Float[Tensor, "k b 6"], white: _Whitened) -> Float[Tensor, "k b 6"]:
    """From the quadratic's coefficients (1, x, y, xx, xy, yy) to x, y, w0, w1, w2, log opacity."""
    g1, gx, gy, gxx, gxy, gyy = grad.unbind(-1)
    dx, dy, w0, w1, w2, u, v = white
    gu = -(u * g1 + w0 * gx)
    gv = -(v * g1 + w1 * gx + w2 * gy)
    return torch.stack(
        (
            -(w0 * gu + w1 * gv),
            -(w2 * gv),
            gu * dx - u * gx - w0 * gxx,
            gv * dx - v * gx - w1 * gxx - w2 * gxy,
            gv * dy - v * gy - w1 * gxy - w2 * gyy,
            g1,
        ),
        -1,
    )
