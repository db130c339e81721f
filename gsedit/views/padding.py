"""Pictures, maps and cameras continued to the right and below, to sides that a number divides.

Nothing is ever resized: a resized picture belongs to another camera, its cells no longer lie where
correspondences were matched, and going back blurs it twice. Only the right and the lower border
move, so that cell (i, j) holds the same pixels as before.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import torch
from jaxtyping import Int, Shaped
from torch import Tensor

from rasterizer.camera import Camera

PadMode = Literal["constant", "edge", "mirror"]
"""constant: one value. edge: the last row and column repeated. mirror: the picture reflected, as
often as it takes; to a network this is neither a streak (as a repeated edge is) nor a frame (as
black is) that it would take for part of the picture."""


def round_up(side: int, multiple: int) -> int:
    """The smallest multiple that is not below `side`."""
    return side + -side % multiple


def pad_camera(camera: Camera, multiple: int) -> Camera:
    """The camera with a picture continued to the right and below; no pixel moves."""
    width, height = (round_up(side, multiple) for side in (camera.width, camera.height))
    return replace(camera, width=width, height=height)


def pad_to_multiple(
    x: Shaped[Tensor, "..."], multiple: int, mode: PadMode, *, axis: int = 1
) -> Shaped[Tensor, "..."]:
    """Rows (at `axis`) and columns (at the next) continued to a multiple; see `pad_to`."""
    height, width = (round_up(side, multiple) for side in x.shape[axis : axis + 2])
    return pad_to(x, height, width, mode, axis=axis)


def pad_to(
    x: Shaped[Tensor, "..."],
    height: int,
    width: int,
    mode: PadMode,
    *,
    axis: int = 1,
    value: int | float = 0,
) -> Shaped[Tensor, "..."]:
    """Rows (at `axis`) continued to `height` and columns (at the next) to `width`.

    Neither may be below what `x` has. `value` is what `constant` adds. The same tensor where
    nothing is to add.
    """
    h, w = x.shape[axis : axis + 2]
    if (h, w) == (height, width):
        return x
    if mode == "constant":
        padded = x.new_full((*x.shape[:axis], height, width, *x.shape[axis + 2 :]), value)
        padded.narrow(axis, 0, h).narrow(axis + 1, 0, w).copy_(x)
        return padded
    rows, columns = _source(h, height, mode), _source(w, width, mode)
    return x.index_select(axis, rows.to(x.device)).index_select(axis + 1, columns.to(x.device))


def _source(side: int, padded: int, mode: PadMode) -> Int[Tensor, " {padded}"]:
    """Index of the row or column that each padded one repeats."""
    index = torch.arange(padded)
    if mode == "edge":
        return index.clamp_max(side - 1)
    index %= 2 * side  # 0 1 ... side-1 side-1 ... 1 0 0 1 ...
    return torch.minimum(index, 2 * side - 1 - index)
