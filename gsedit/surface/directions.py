"""Maps of all directions around a point: `h w` cells by polar angle from +z and azimuth from +x.

Cell centers lie at half steps; a map's rows go from +z down, its columns once around.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

FAINT = 1e-12
"""Weight below which a mean is 0 by 0."""


@lru_cache(8)
def cell_directions(height: int) -> Float[Tensor, "h w 3"]:
    """Unit vectors to the centers of the cells of a map with w = 2 h."""
    polar = (torch.arange(height) + 0.5) * (pi / height)
    azimuth = (torch.arange(2 * height) + 0.5) * (pi / height)
    ring, z = polar.sin()[:, None], polar.cos()[:, None].expand(-1, 2 * height)
    return torch.stack((ring * azimuth.cos(), ring * azimuth.sin(), z), -1)


@lru_cache(8)
def cell_areas(height: int) -> Float[Tensor, "h w"]:
    """Solid angles of the cells of a map with w = 2 h, steradians: they sum to 4 pi."""
    edges = (torch.arange(height + 1) * (pi / height)).cos()
    return ((edges[:-1] - edges[1:]) * (pi / height))[:, None].expand(-1, 2 * height).clone()


def look_up(
    values: Float[Tensor, "h w c"], directions: Float[Tensor, "*n 3"]
) -> Float[Tensor, "*n c"]:
    """A map at unit directions, bilinear between cells; constant beyond the rows at the poles."""
    h, w, channels = values.shape
    flat = directions.reshape(-1, 3)
    row = (torch.acos(flat[:, 2].clamp(-1, 1)) * (h / pi) - 0.5).clamp(0, h - 1)
    column = torch.atan2(flat[:, 1], flat[:, 0]) * (w / (2 * pi)) - 0.5
    top, left = row.floor().clamp_max(max(h - 2, 0)), column.floor()
    down, right = (row - top)[:, None], (column - left)[:, None]
    # once around is from -w / 2 to w / 2: remainders of integers would take half of the time
    lefts = torch.where(left < 0, left + w, left).int()
    rights = torch.where(lefts == w - 1, 0, lefts + 1)
    first = top.int() * w
    second = first + (w if h > 1 else 0)
    cells = values.reshape(h * w, channels)
    upper, lower = (
        torch.lerp(cells.index_select(0, row + lefts), cells.index_select(0, row + rights), right)
        for row in (first, second)
    )
    return torch.lerp(upper, lower, down).reshape(*directions.shape[:-1], channels)


def halved(values: Float[Tensor, "h w c"], height: int) -> Float[Tensor, "g v c"]:
    """The map with `height` rows, means by solid angle; its own number of rows is a multiple."""
    h, w, channels = values.shape
    step = h // height
    weighted = torch.cat((values, torch.ones_like(values[..., :1])), -1)
    weighted = weighted * cell_areas(h)[..., None].to(values)
    sums = weighted.reshape(height, step, w // step, step, channels + 1).sum((1, 3))
    return sums[..., :-1] / sums[..., -1:]


def filtered(
    values: Float[Tensor, "h w c"], kernel: Float[Tensor, "m m"], weights: Float[Tensor, "h w"]
) -> Float[Tensor, "h w c"]:
    """Means over all cells, by a kernel between cells and each cell's weight."""
    h, w, channels = values.shape
    by_cell = kernel * weights.reshape(1, -1)
    total = by_cell.sum(1, keepdim=True).clamp_min(FAINT)
    return ((by_cell @ values.reshape(h * w, channels)) / total).reshape(h, w, channels)
