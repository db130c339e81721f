"""Grey patterns that repeat: noise, grains, leaves, cells, cracks, bricks, wood, prints.

Each is a tile of TILE^2 texels, `s s`, in [0, 1] (masonry and wood within a narrower range), whose
left and right edges meet, and upper and lower.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

from research.train_small.pictures.random_stream import RandomStream

TILE = 256  # texels a side; a power of 2


def fractal(rng: RandomStream, slope: float) -> Float[Tensor, "s s"]:
    """Noise whose amplitude falls as 1 / frequency^slope."""
    spectrum = torch.fft.rfft2(_white(rng)) / frequency().clamp_min(1) ** slope
    spectrum[0, 0] = 0
    return _spread(torch.fft.irfft2(spectrum))


def speckle(rng: RandomStream, sigma: float, sharpness: float) -> Float[Tensor, "s s"]:
    """Grains of `sigma` texels, dark ones rarer than light ones: granite."""
    noise = _filtered(rng, gaussian(sigma))
    return _spread(torch.sigmoid(sharpness * (noise / noise.std() + 0.7)))


def blades(rng: RandomStream) -> Float[Tensor, "s s"]:
    """Short strokes in several directions, the lightest on top: grass, needles, fur."""
    y, x = torch.fft.fftfreq(TILE)[:, None], torch.fft.rfftfreq(TILE)
    best = torch.full((TILE, TILE), -torch.inf)
    for _ in range(5):
        angle = rng(-0.7, 0.7)
        along, across = x * sin(angle) + y * cos(angle), x * cos(angle) - y * sin(angle)
        stroke = _filtered(rng, (-((30 * along) ** 2) - (4 * across) ** 2).exp())
        best = torch.maximum(best, stroke / stroke.std())
    return _spread(best)


def cells(rng: RandomStream, count: int) -> Float[Tensor, "s s"]:
    """`count` pebbles: a grey of its own each, darker toward the gaps."""
    first, second, site = _nearest(rng, count)
    tone = torch.rand((count,), generator=rng.generator)[site]
    gap = ((second - first) / (0.25 * TILE / sqrt(count))).clamp(0, 1)
    return _spread(tone * gap + 0.3 * gap)


def leaves(rng: RandomStream, count: int) -> Float[Tensor, "s s"]:
    """Foliage: `count` light discs over dark hollows."""
    first, _, site = _nearest(rng, count)
    tone = torch.rand((count,), generator=rng.generator)[site]
    disc = torch.sigmoid(6 * (0.7 - first / (TILE / sqrt(count) * 0.7)))
    hollow = fractal(rng, 1.4)
    return _spread(tone * disc + rng(0.3, 1.2) * hollow)


def cracks(rng: RandomStream, slope: float) -> Float[Tensor, "s s"]:
    """Thin dark lines through soft noise, the zeros of fractal noise of that slope: rock, bark."""
    ridge = (fractal(rng, slope) - 0.5).abs()
    return _spread((ridge / 0.05).clamp(0, 1) + 1.5 * fractal(rng, 1.2), 0.2)


def masonry(rng: RandomStream, rows: int, columns: int) -> Float[Tensor, "s s"]:
    """Bricks, slabs or planks with joints, a tone each: so many rows and columns a tile."""
    y, x = torch.meshgrid(torch.arange(TILE) / TILE, torch.arange(TILE) / TILE, indexing="ij")
    row = (y * rows).floor()
    shifted = x * columns + 0.5 * (row % 2)
    brick = (shifted.floor() % columns + columns * row).long()
    tone = torch.tensor([rng() for _ in range(rows * columns)])[brick]
    joint = torch.minimum(_to_edge(y * rows) / rows, _to_edge(shifted) / columns) * TILE
    return (0.35 + 0.5 * tone) * (0.4 + 0.6 * (joint / 2).clamp(0, 1))


def wood(rng: RandomStream) -> Float[Tensor, "s s"]:
    """Draw warped fine lines."""
    x = torch.arange(TILE) / TILE
    warp = fractal(rng, 2.2)
    rings = (2 * pi * (rng.integer(8, 20) * x + 2.5 * warp)).sin()
    return 0.5 + 0.35 * rings * fractal(rng, 1.2)


def lines(count: int) -> Float[Tensor, "s s"]:
    """`count` rows, black and white by turns."""
    return _alternate(count).float()[:, None].expand(TILE, TILE)


def checks(count: int) -> Float[Tensor, "s s"]:
    """A chessboard of `count` rows."""
    odd = _alternate(count)
    return (odd[:, None] ^ odd).float()


def dots(count: int) -> Float[Tensor, "s s"]:
    """`count` rows of discs."""
    x = (torch.arange(TILE) * count / TILE) % 1 - 0.5
    return ((x[:, None].square() + x.square()).sqrt() < 0.3).float()


def frequency() -> Float[Tensor, "s f"]:
    """Cycles per tile, in the layout of rfft2."""
    y = torch.fft.fftfreq(TILE, 1 / TILE)[:, None]
    return (y.square() + torch.fft.rfftfreq(TILE, 1 / TILE).square()).sqrt()


def gaussian(sigma: float) -> Float[Tensor, "s f"]:
    """The transfer function of a Gaussian blur of `sigma` texels, in the layout of rfft2."""
    return (-2 * (pi * (sigma / TILE) * frequency()) ** 2).exp()


def _white(rng: RandomStream) -> Float[Tensor, "s s"]:
    return torch.randn((TILE, TILE), generator=rng.generator)


def _filtered(rng: RandomStream, transfer: Float[Tensor, "s f"]) -> Float[Tensor, "s s"]:
    return torch.fft.irfft2(torch.fft.rfft2(_white(rng)) * transfer)


def _spread(tile: Float[Tensor, "s s"], spread: float = 0.25) -> Float[Tensor, "s s"]:
    """Around 0.5 with a standard deviation of `spread`, clipped to [0, 1]."""
    return (0.5 + spread * (tile - tile.mean()) / tile.std().clamp_min(1e-6)).clamp(0, 1)


def _nearest(
    rng: RandomStream, count: int
) -> tuple[Float[Tensor, "s s"], Float[Tensor, "s s"], Int[Tensor, "s s"]]:
    """Distances (texels) of every texel to the two nearest of random sites, and the nearest
    site."""
    random = torch.rand((count, 2), generator=rng.generator, dtype=torch.float64)
    grid = np.indices((TILE, TILE)).reshape(2, -1).T
    distance, site = KDTree((random * TILE).numpy(), boxsize=TILE).query(grid, k=2)
    first, second = torch.from_numpy(distance).float().reshape(TILE, TILE, 2).unbind(-1)
    return first, second, torch.from_numpy(np.asarray(site)[:, 0]).reshape(TILE, TILE)


def _to_edge(x: Float[Tensor, "s s"]) -> Float[Tensor, "s s"]:
    """How far numbers are from the nearest whole one."""
    return 0.5 - (x % 1 - 0.5).abs()


def _alternate(count: int) -> Int[Tensor, " s"]:
    """0 and 1 by turns, `count` runs a tile."""
    return (torch.arange(TILE) * count // TILE) % 2
