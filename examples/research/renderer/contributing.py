"""Count of the pixel-pairs that change a picture, beside those that are evaluated.

`b` tiles of `q` pixels with lists of up to `k` Gaussians.
"""

from __future__ import annotations

import torch
from jaxtyping import Int
from torch import Tensor

from rasterizer import Camera, Gaussians, Numerics
from rasterizer.numerics import DEFAULT
from research.renderer.pairs import BinnedGaussians, bin_gaussians

ELEMENTS = 1 << 22
"""Pixel-pairs that are evaluated at once."""


@torch.no_grad()
def contributing_pairs(scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT) -> int:
    """Pixel-pairs with alpha at or above the floor, in front of each pixel's early stop.

    Takes longer than drawing: never inside a timed region.
    """
    binned = bin_gaussians(scene, camera, numerics)
    bins, lengths = binned.bins, binned.bins.starts.diff()
    order = torch.argsort(lengths, descending=True)
    total, done, filled = 0, 0, int((lengths > 0).sum())
    while done < filled:
        longest = int(lengths[order[done]])
        count = max(1, ELEMENTS // (longest * bins.size**2))
        tiles = order[done : min(filled, done + count)]
        total += _contributing(binned, tiles, camera, numerics)
        done += count
    return total


def _contributing(
    binned: BinnedGaussians, tiles: Int[Tensor, " b"], camera: Camera, numerics: Numerics
) -> int:
    """Pixel-pairs of some tiles that change the picture."""
    bins = binned.bins
    starts, ends = bins.starts[tiles], bins.starts[tiles + 1]
    at = starts + torch.arange(int((ends - starts).max()))[:, None]
    missing = at >= ends  # [k, b]
    members = bins.members[at.masked_fill(missing, 0)]
    corner = torch.stack((tiles % bins.columns, tiles // bins.columns), -1) * bins.size
    inside = torch.arange(bins.size)
    y, x = (c.flatten() for c in torch.meshgrid(inside, inside, indexing="ij"))
    x, y = corner[:, :1] + x, corner[:, 1:] + y  # [b, q]
    in_picture = (x < camera.width) & (y < camera.height)
    center = binned.xy[members]
    dx = x + 0.5 - center[..., :1]  # [k, b, q]
    dy = y + 0.5 - center[..., 1:]
    w0, w1, w2 = binned.whitening[members][..., None, :].unbind(-1)
    power = 0.5 * ((w0 * dx).square() + (w1 * dx + w2 * dy).square())
    alpha = (binned.log_opacities[members][..., None] - power).exp_().clamp_max_(numerics.alpha_max)
    drawn = (alpha >= numerics.alpha_min) & in_picture & ~missing[..., None]
    after = (1 - alpha * drawn).cumprod(0)  # transmittance behind each Gaussian
    before = torch.cat((torch.ones_like(after[:1]), after[:-1]))
    return int((drawn & (before > numerics.transmittance_min)).sum())
