"""Checks of the inputs: a ValueError names the first number that cannot be drawn.

Without them a NaN would pass unnoticed: no comparison with it is true, so culling drops such rows
silently, and one that is drawn spoils every pixel and every gradient behind it.

Finite inputs cost one sum: it is finite unless a term is not. (A sum of finite numbers may
overflow; then every number is tested.)
"""

from __future__ import annotations

from math import inf, isfinite

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import Numerics
from rasterizer.project import Box, Projected
from rasterizer.scene import Gaussians

ALLOWED_INFINITIES = {"log_scales": (-inf,), "logit_opacities": (-inf, inf)}
"""By field: they stand for a scale of 0, and for opacities of 0 and 1."""


@torch.no_grad()
def finite(
    name: str,
    values: Float[Tensor, "m ..."],
    rows: Int[Tensor, " m"] | None = None,
    allowed: tuple[float, ...] = (),
) -> None:
    """ValueError unless all values are finite, or one of the infinities that are allowed.

    `rows` are the values' row numbers in the input, for the message, where they are a selection.
    """
    if isfinite(values.sum()):
        return
    bad = ~values.isfinite()
    for value in allowed:
        bad &= values != value
    if not bad.any():
        return
    first = bad.nonzero()[0].tolist()
    at = [first[0] if rows is None else int(rows[first[0]]), *first[1:]]
    remark = _count(bad.view(len(bad), -1).any(1), rows is not None)
    raise ValueError(f"{name}{at} is {values[tuple(first)].item()}, {remark}")


@torch.no_grad()
def all_finite(name: str, values: Float[Tensor, "..."]) -> None:
    """ValueError that names the first number of a small tensor that is not finite."""
    bad = ~values.isfinite()
    if bad.any():
        first = bad.nonzero()[0].tolist()
        raise ValueError(f"{name}{first} is {values[tuple(first)].item()}: it must be finite")


def scene(gaussians: Gaussians) -> None:
    """ValueError unless every row has a position, a shape and an opacity.

    Harmonics are checked in `preprocess`, for rows in sight only.
    """
    count = len(gaussians)
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
        values = getattr(gaussians, name)
        if len(values) != count:
            raise ValueError(f"{name} has {len(values)} rows, means has {count}: one a Gaussian")
        if name != "sh":
            finite(name, values, allowed=ALLOWED_INFINITIES.get(name, ()))


def camera(view: Camera) -> None:
    """ValueError unless pose and intrinsics are usable and the picture has pixels."""
    all_finite("camera.world_to_camera", view.world_to_camera)
    for name in ("fx", "fy"):
        focal = getattr(view, name)
        if not (isfinite(focal) and focal > 0):
            raise ValueError(f"camera.{name} is {focal}: focal lengths are above 0, in pixels")
    for name in ("cx", "cy"):
        if not isfinite(getattr(view, name)):
            raise ValueError(
                f"camera.{name} is {getattr(view, name)}: a principal point is finite, in pixels"
            )
    if min(view.width, view.height) < 1:
        raise ValueError(f"the camera's picture is {view.width}x{view.height}: it has no pixel")


def crop(box: Box, camera: Camera) -> None:
    """ValueError unless a box has pixels and lies in the camera's picture."""
    left, top, width, height = box
    inside = left >= 0 and top >= 0
    inside &= left + width <= camera.width and top + height <= camera.height
    if not inside or min(width, height) < 1:
        raise ValueError(f"crop {box} does not lie in a picture of {camera.width}x{camera.height}")


def settings(numerics: Numerics) -> None:
    """ValueError for a setting that is NaN: comparisons with it would all be false."""
    for name, value in vars(numerics).items():
        if value != value:
            raise ValueError(f"{name} is nan: leave it out for its default")


@torch.no_grad()
def footprints(
    projected: Projected, rows: Int[Tensor, " m"], names: tuple[str, str] = ("means", "log_scales")
) -> None:
    """ValueError unless positions and sizes on the picture are finite in the dtype.

    Of finite inputs two overflow: footprints wider than the root of the largest number (1e19 pixels
    in float32), and centers within 1e-38 of the camera's plane where `near` is 0. `rows` are their
    row numbers in the input, `names` what the caller calls their centers and their sizes.
    """
    shape = (projected.whitening, projected.covariance)
    if isfinite(projected.xy.sum() + sum(part.sum() for part in shape)):
        return
    dtype = str(projected.xy.dtype).removeprefix("torch.")
    off = ~projected.xy.isfinite().all(1)
    if off.any():
        raise ValueError(
            f"{names[0]}[{_first(rows, off)}] is too close to the camera: its place on the "
            f"picture is beyond {dtype}, {_count(off, True)}; or raise `near`"
        )
    bad = ~torch.cat(shape, 1).isfinite().all(1)
    if bad.any():
        raise ValueError(
            f"{names[1]}[{_first(rows, bad)}] is out of range: its variance on the picture is "
            f"beyond {dtype}, {_count(bad, True)}"
        )


def _first(rows: Int[Tensor, " m"], bad: Bool[Tensor, " m"]) -> int:
    return int(rows[bad.nonzero()[0, 0]])


def _count(bad: Bool[Tensor, " n"], in_sight: bool) -> str:
    count, among = int(bad.sum()), f"{len(bad)}{' in sight' if in_sight else ''}"
    if count == 1:
        return f"the only bad row of {among}: leave it out, or find what made it"
    return f"the first of {count} bad rows of {among}: leave them out, or find what made them"
