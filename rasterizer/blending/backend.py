"""Record that makes an implementation of blending: its two passes, and their cost.

A backend is one file in this folder that ends in such a record, and its entry in `choose.BACKENDS`,
before the torch backend's; a third one touches nothing else where device, dtype and the fields of
`Execution` tell when it is wanted. (A choice that they cannot tell is a new field of `Execution`.)
The steps around it make their tensors on the Gaussians' device; none has run on a GPU yet.

`m` Gaussians with `d` features, a picture of `h w` pixels; `g` = 6 + d.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.numerics import Execution, Numerics
from rasterizer.tiles import Bins

GEOMETRY = 6
"""Columns of the table before the features: x, y, w0, w1, w2, log opacity."""


class BlendInputs(NamedTuple):
    """2D Gaussians, listed by tile, and the picture that they are blended into."""

    table: Float[Tensor, "m g"]
    """x, y (pixels from the picture's corner), w0, w1, w2 (see `Projected`), the natural logarithm
    of the opacity, then the features. float32 or float64."""
    bins: Bins
    width: int
    """Picture width, pixels; its height is below."""
    height: int
    numerics: Numerics
    wanted: Float[Tensor, "h w"] | None = None
    """0 where a picture may be black, and maps are 0 that are pulled. None: nowhere."""


class Blended(NamedTuple):
    """Blended rectangle of pixels, over black."""

    features: Float[Tensor, "h w d"]
    transmittance: Float[Tensor, "h w"]
    median_index: Int[Tensor, "h w"] | None
    """Row of the Gaussian at which the transmittance falls to one half; -1: none. None: not
    computed."""


def median_depths(depths: Float[Tensor, " m"], index: Int[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """The depths of the table's rows that a median index names; 0 where it is -1."""
    return torch.cat((depths, depths.new_zeros(1)))[index]


def median_rows(rows: Int[Tensor, " m"], index: Int[Tensor, "h w"]) -> Int[Tensor, "h w"]:
    """The scene's rows, of the table's, that a median index names; -1 where it is -1."""
    return torch.cat((rows, rows.new_full((1,), -1)))[index].long()


def refuse_second_derivatives() -> None:
    """Raise RuntimeError in a backward pass whose own gradients are wanted: they would be silently
    wrong."""
    if torch.is_grad_enabled():
        raise RuntimeError("a picture has first derivatives only: leave out create_graph=True")


class ForwardPass(NamedTuple):
    """A blended picture, and whatever the backend's backward pass needs beside it."""

    blended: Blended
    saved: Any


@dataclass(frozen=True)
class Backend:
    """One implementation of the blending of `reference.py`."""

    name: str
    accepts: Callable[[Execution, torch.device, torch.dtype], bool]
    """(execution, device and dtype of the table): whether it blends such tensors, can run here and
    is not ruled out by the execution."""
    forward: Callable[[BlendInputs, bool, bool], ForwardPass]
    """(inputs, whether the median index is wanted, whether `backward` may be called). The table
    has no gradients here."""
    backward: Callable[
        [Any, Float[Tensor, "h w"], Float[Tensor, "h w d"], Float[Tensor, "h w"]],
        Float[Tensor, "m g"],
    ]
    """(saved, transmittance, gradients of the loss by features and by transmittance) to the
    gradient by the table."""
    pull: Callable[[BlendInputs, Float[Tensor, "h w 3"]], Float[Tensor, "m 3"]]
    """(inputs of three features, three maps) to the sums over pixels of each map times the weight
    of every row of the table; its features are not read."""
    pair_overhead: float
    """The cost model, from which the tile's size is chosen: what a pair costs before any pixel is
    looked at (list, gather, gradient row), in units of one pixel of one pair."""
