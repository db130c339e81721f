"""How much work a picture is, counted in pairs: counts of two renderers can be compared.

A pair is a Gaussian in a tile's list, a pixel-pair a Gaussian at a pixel of such a tile.
`b` tiles of `q` pixels with lists of up to `k` Gaussians.
"""

from __future__ import annotations

from math import log
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import Camera, Execution, Gaussians, Numerics
from rasterizer.blending.choose import choose_backend
from rasterizer.numerics import AUTO, DEFAULT
from rasterizer.preprocess import preprocess, stored_scene
from rasterizer.splat import list_tiles
from rasterizer.tiles import Bins

ELEMENTS = 1 << 22  # pixel-pairs looked at together


@torch.no_grad()
def listed_pairs(
    scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT, execution: Execution = AUTO
) -> tuple[int, int]:
    """(tile, Gaussian) pairs, and their pixels: what a renderer without early stop evaluates."""
    bins = _flattened(scene, camera, numerics, execution).bins
    tiled = len(bins.members)
    return tiled, tiled * bins.size**2


@torch.no_grad()
def contributing_pairs(scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT) -> int:
    """Pixel-pairs with alpha at or above the floor, in front of each pixel's early stop.

    Takes longer than drawing: never inside a timed region.
    """
    flat = _flattened(scene, camera, numerics, AUTO)
    bins, lengths = flat.bins, flat.bins.starts.diff()
    order = torch.argsort(lengths, descending=True)
    total, done, full = 0, 0, int((lengths > 0).sum())
    while done < full:
        longest = int(lengths[order[done]])
        count = max(1, ELEMENTS // (longest * bins.size**2))
        tiles = order[done : min(full, done + count)]
        total += _contributing(flat, tiles, camera, numerics)
        done += count
    return total


@torch.no_grad()
def nearest_to_floor(
    scene: Gaussians,
    camera: Camera,
    pixels: Int[Tensor, "p 2"],
    numerics: Numerics = DEFAULT,
) -> Float[Tensor, " p"]:
    """Least relative distance from the floor of a Gaussian's alpha at each pixel (row, column);
    at most 1.

    Near 0, a rounding decides whether a step of alpha_min is drawn. In float64, without tiles.
    """
    flat = _flattened(scene.to(torch.float64), camera, numerics, AUTO)
    w0, w1, w2 = flat.whitening.unbind(-1)
    nearest = [torch.ones(0, dtype=torch.float64)]
    for some in pixels.split(32):
        dx, dy = (some.flip(-1)[:, None] + 0.5 - flat.xy).unbind(-1)
        power = 0.5 * ((w0 * dx).square() + (w1 * dx + w2 * dy).square())
        excess = flat.log_opacities - power - numerics.log_alpha_min
        nearest.append(_least(excess))
    return torch.cat(nearest)


def _least(excess: Float[Tensor, "p n"]) -> Float[Tensor, " p"]:
    """Relative distance of the alpha whose logarithm is nearest; 1 where there is none."""
    nobody = excess.new_full((len(excess), 1), log(2))
    return torch.expm1(torch.cat((excess.abs(), nobody), -1).amin(-1))


class _Flat(NamedTuple):
    """2D Gaussians, and the Gaussians of each tile: as splat lists them."""

    xy: Float[Tensor, "n 2"]
    whitening: Float[Tensor, "n 3"]
    log_opacities: Float[Tensor, " n"]
    bins: Bins


def _flattened(scene: Gaussians, camera: Camera, numerics: Numerics, execution: Execution) -> _Flat:
    box = (0, 0, camera.width, camera.height)
    splats = preprocess(stored_scene(scene), camera, box, numerics, color=False)
    xy, bins = list_tiles(splats, box, numerics, execution, choose_backend(execution))
    return _Flat(xy, splats.projected.whitening, splats.log_opacities, bins)


def _contributing(flat: _Flat, tiles: Int[Tensor, " b"], camera: Camera, numerics: Numerics) -> int:
    """Pixel-pairs of some tiles that change the picture."""
    bins = flat.bins
    starts, ends = bins.starts[tiles], bins.starts[tiles + 1]
    at = starts + torch.arange(int((ends - starts).max()))[:, None]
    missing = at >= ends  # [k, b]
    members = bins.members[at.masked_fill(missing, 0)]
    corner = torch.stack((tiles % bins.columns, tiles // bins.columns), -1) * bins.size
    inside = torch.arange(bins.size)
    y, x = (c.flatten() for c in torch.meshgrid(inside, inside, indexing="ij"))
    x, y = corner[:, :1] + x, corner[:, 1:] + y  # [b, q]
    picture = (x < camera.width) & (y < camera.height)
    centre = flat.xy[members]
    dx = x + 0.5 - centre[..., :1]  # [k, b, q]
    dy = y + 0.5 - centre[..., 1:]
    w0, w1, w2 = flat.whitening[members][..., None, :].unbind(-1)
    power = 0.5 * ((w0 * dx).square() + (w1 * dx + w2 * dy).square())
    alpha = (flat.log_opacities[members][..., None] - power).exp_().clamp_max_(numerics.alpha_max)
    kept = (alpha >= numerics.alpha_min) & picture & ~missing[..., None]
    passed = (1 - alpha * kept).cumprod(0)
    before = torch.cat((torch.ones_like(passed[:1]), passed[:-1]))
    return int((kept & (before > numerics.transmittance_min)).sum())
