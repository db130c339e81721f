"""What one tensor goes through in a step of `row_adam`: in torch, or in C++ in one pass.

`n` rows, of which `m` move (`rows`, ascending; None: all). Everything is changed in place.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.compiled import function
from rasterizer.compiled import load as load_library

BETA_1, BETA_2 = 0.9, 0.999
EPSILON = 1e-15
"""As 3D Gaussian splatting has it: gradients of single splats are tiny."""
SOURCE = Path(__file__).with_name("row_adam.cpp")


class Moving(NamedTuple):
    """A tensor and the running means of its gradient and of its gradient's square."""

    value: Float[Tensor, "n ..."]
    first: Float[Tensor, "n ..."]
    second: Float[Tensor, "n ..."]


def step(
    moving: Moving,
    gradient: Float[Tensor, "m ..."] | None,
    rows: Int[Tensor, " m"] | None,
    rate: float,
    bias_2: float,
    shares: Float[Tensor, "..."] | None = None,
    *,
    compiled: bool = False,
) -> None:
    """One step; `rate` over the bias of the first moments, root of that of the second. Without a
    gradient it is zero. `shares`: of the rate, that each of a row's values has."""
    if compiled and _accepts(moving, gradient):
        return _run("step", moving, gradient, rows, shares, rate=rate, bias_2=bias_2)
    if rows is None:
        return _step(moving, gradient, rate, bias_2, shares)
    few = Moving(*(each.index_select(0, rows) for each in moving))
    _step(few, gradient, rate, bias_2, shares)
    _copy(few, moving, rows)


def settle(
    moving: Moving,
    rows: Int[Tensor, " m"],
    missed: Float[Tensor, " m"],
    steps: Int[Tensor, " m"],
    shares: Float[Tensor, "..."] | None = None,
    *,
    compiled: bool = False,
) -> None:
    """Move rows by `missed` times their m / sqrt(v), and fade their moments by so many steps.
    `shares`: of `missed`, that each of a row's values has."""
    like = moving.value
    missed = missed.to(like)
    fade_1, fade_2 = (torch.pow(beta, steps).to(like) for beta in (BETA_1, BETA_2))
    if compiled and _accepts(moving, None):
        fading = {"fade_1": fade_1, "fade_2": fade_2}
        return _run("settle", moving, None, rows, shares, missed=missed, **fading)
    few = Moving(*(each.index_select(0, rows) for each in moving))
    shape = (-1, *(1,) * (like.ndim - 1))
    missed, fade_1, fade_2 = (each.view(shape) for each in (missed, fade_1, fade_2))
    missed = missed if shares is None else missed * shares.to(like)
    few.value.sub_(few.first / (few.second.sqrt() + EPSILON) * missed)
    few.first.mul_(fade_1)
    few.second.mul_(fade_2)
    _copy(few, moving, rows)


def _step(
    moving: Moving, gradient: Tensor | None, rate: float, bias_2: float, shares: Tensor | None
) -> None:
    value, first, second = moving
    if gradient is None:
        first *= BETA_1
        second *= BETA_2
    else:
        first.lerp_(gradient, 1 - BETA_1)
        second.mul_(BETA_2).addcmul_(gradient, gradient, value=1 - BETA_2)
    change = first if shares is None else first * shares.to(first)
    value.addcdiv_(change, second.sqrt().div_(bias_2).add_(EPSILON), value=-rate)


def _copy(few: Moving, moving: Moving, rows: Tensor) -> None:
    for target, source in zip(moving, few):
        target.index_copy_(0, rows, source)


# ---- the same in C++ -----------------------------------------------------------------------------


class _Job(ctypes.Structure):
    """`Job` of row_adam.cpp."""

    _fields_ = (
        [(name, ctypes.c_void_p)
         for name in ("value", "first", "second", "gradient", "rows",
                      "missed", "fade_1", "fade_2", "shares")]
        + [(name, ctypes.c_int64) for name in ("count", "columns", "threads")]
        + [(name, ctypes.c_double) for name in ("beta_1", "beta_2", "epsilon", "rate", "bias_2")]
    )  # fmt: skip


def load() -> ctypes.CDLL | None:
    """The kernel; None where it cannot be compiled."""
    return load_library(SOURCE)


def _accepts(moving: Moving, gradient: Tensor | None) -> bool:
    value = moving.value
    return (
        value.device.type == "cpu"
        and value.dtype in (torch.float32, torch.float64)
        and all(each.is_contiguous() and each.dtype == value.dtype for each in moving)
        and (gradient is None or gradient.dtype == value.dtype)
        and load() is not None
    )


def _run(
    name: str,
    moving: Moving,
    gradient: Tensor | None,
    rows: Tensor | None,
    shares: Tensor | None,
    **more: Any,
) -> None:
    kernel = load()
    assert kernel is not None, "ask _accepts() first"
    count = len(moving.value) if rows is None else len(rows)
    # held until the kernel returns: it gets addresses only
    if shares is not None:
        shares = shares.to(moving.value).expand(moving.value.shape[1:])
    held = {**moving._asdict(), "gradient": gradient, "rows": rows, "shares": shares, **more}
    held = {k: v.contiguous() for k, v in held.items() if isinstance(v, Tensor)}
    job = _Job(
        count=count, columns=moving.value.numel() // max(1, len(moving.value)),
        threads=torch.get_num_threads(), beta_1=BETA_1, beta_2=BETA_2, epsilon=EPSILON,
        **{k: v for k, v in more.items() if not isinstance(v, Tensor)},
        **{k: v.data_ptr() for k, v in held.items()},
    )  # fmt: skip
    if function(kernel, name, moving.value.dtype)(ctypes.byref(job)):
        raise MemoryError(f"no memory to move {count} rows on {job.threads} threads")
