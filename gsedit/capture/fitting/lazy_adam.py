"""Lazy Adam (Kingma and Ba 2015): a step updates the given rows; skipped rows catch up when used.

A row without a gradient still moves under Adam, by its momentum, which fades. Here such a row is
left alone until it is next used, and then makes all the steps that it skipped at once: over k steps
without a gradient its moments are m b1^j and v b2^j, so that it moves by

    m / sqrt(v) * sum_j rate_j sqrt(1 - b2^t_j) / (1 - b1^t_j) (b1 / sqrt(b2))^j,

a product of its own moments and a number that depends on the steps alone. To rounding, this equals
a step over all rows.

`n` rows, of which a step has `m`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from math import sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.run.state import tensor_like
from rasterizer.compiled import function
from rasterizer.compiled import load as load_library

BETA_1, BETA_2 = 0.9, 0.999
EPSILON = 1e-15
"""As 3D Gaussian splatting has it: gradients of single splats are tiny."""
SOURCE = Path(__file__).with_name("adam.cpp")


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
    """Apply one Adam step in place, to all rows or the given ones.

    At step t, `rate` = lr / (1 - b1^t) and `bias_2` = sqrt(1 - b2^t). Without a gradient, it is
    zero. `shares` are factors of the rate for each value of a row.
    """
    if compiled and _accepts(moving, gradient, rows):
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
    """Let rows catch up: move them by `missed` times their m / sqrt(v), fade their moments by
    `steps`. `shares` are factors of `missed` for each value of a row."""
    like = moving.value
    missed = missed.to(like)
    powers = torch.arange(int(steps.max()) + 1 if len(steps) else 0, dtype=torch.float64)
    fade_1, fade_2 = ((beta**powers).to(like)[steps] for beta in (BETA_1, BETA_2))
    if compiled and _accepts(moving, None, rows):
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
    """Argument `Job` of adam.cpp."""

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


def _accepts(moving: Moving, gradient: Tensor | None, rows: Tensor | None) -> bool:
    """Whether the kernel may be called: it gets addresses, and reads and writes without a check."""
    value = moving.value
    drawn = (len(value) if rows is None else len(rows), *value.shape[1:])
    return (
        value.device.type == "cpu"
        and value.dtype in (torch.float32, torch.float64)
        and all(each.is_contiguous() for each in moving)
        and all((each.shape, each.dtype) == (value.shape, value.dtype) for each in moving)
        and (gradient is None or (gradient.shape, gradient.dtype) == (drawn, value.dtype))
        and (rows is None or _are_rows(rows, len(value)))
        and load() is not None
    )


def _are_rows(rows: Tensor, count: int) -> bool:
    if rows.dtype != torch.int64 or rows.ndim != 1:
        return False
    return not len(rows) or (int(rows.min()) >= 0 and int(rows.max()) < count)


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


MOST_STEPS = (1 << 31) - 1
"""Steps that the count of each row can hold."""
FADING = BETA_1 / sqrt(BETA_2)
"""By which the movement of a row without a gradient is smaller at each step."""


class LazyAdam:
    """The moments of `n` rows of named tensors, and the step at which each row was last moved."""

    def __init__(
        self, count: int, *, shares: Mapping[str, Tensor] | None = None, compiled: bool = False
    ) -> None:
        """`shares`, by name: what the rate of each of a row's values is multiplied by, in a shape
        that broadcasts to a row's; 1 for names that are not there. `compiled`: steps by the C++
        kernel, where there is one; equal to rounding."""
        self.shares = shares or {}
        self.compiled = compiled
        self.steps = 0
        self._moments: dict[str, tuple[Tensor, Tensor]] = {}
        self._settled = 0
        """Step up to which all rows are moved."""
        self._last = torch.zeros(count, dtype=torch.int32)
        """Step up to which each row is moved."""
        self._missed: dict[str, np.ndarray] = {}
        """By name: how far a row of unit m / sqrt(v), last moved at step `_settled` + i, has to
        move."""

    @torch.no_grad()
    def step(
        self,
        values: Mapping[str, Tensor],
        gradients: Mapping[str, Tensor],
        rates: Mapping[str, float],
        rows: Int[Tensor, " m"] | None = None,
    ) -> None:
        """Move `values`, in place, against the gradients of their `rows` (None: of all rows).

        The rows must be settled. A name without a gradient has a gradient of zero.
        """
        self.steps += 1
        bias_1, bias_2 = 1 - BETA_1**self.steps, sqrt(1 - BETA_2**self.steps)
        for name, rate in rates.items():
            self._count_missed(name, rate * bias_2 / bias_1)
            gradient = gradients.get(name)
            if gradient is None and name not in self._moments:
                continue
            if name not in self._moments:
                zeros = torch.zeros_like(values[name])
                self._moments[name] = zeros, torch.zeros_like(zeros)
            moving = Moving(values[name].detach(), *self._moments[name])
            shares = self.shares.get(name)
            step(moving, gradient, rows, rate / bias_1, bias_2, shares, compiled=self.compiled)
        if rows is None:
            self._settle_all()
        else:
            self._last[rows] = self.steps

    def _count_missed(self, name: str, distance: float) -> None:
        """A row moves by `distance` (times its m / sqrt(v)) in this step, less if it is behind."""
        missed = self._missed.get(name, np.zeros(1))
        behind = np.arange(len(missed), 0, -1)
        self._missed[name] = np.append(missed + distance * FADING**behind, 0.0)

    def _settle_all(self) -> None:
        self._settled = self.steps
        self._last.fill_(self.steps)
        self._missed = {}

    @torch.no_grad()
    def settle(self, values: Mapping[str, Tensor], rows: Int[Tensor, " m"] | None = None) -> None:
        """Move the rows (None: all) by what they missed, in place."""
        if self._settled == self.steps:
            return
        behind = self._last < self.steps if rows is None else self._last[rows] < self.steps
        late = behind.nonzero().squeeze(-1) if rows is None else rows[behind]
        since = self._last[late].long()
        for name, moments in self._moments.items():
            missed = torch.from_numpy(self._missed[name])[since - self._settled]
            moving = Moving(values[name].detach(), *moments)
            steps, shares = self.steps - since, self.shares.get(name)
            settle(moving, late, missed, steps, shares, compiled=self.compiled)
        if rows is None:
            self._settle_all()
        else:
            self._last[late] = self.steps

    def selected(self, origin: Int[Tensor, " m"], fresh: Bool[Tensor, " m"]) -> LazyAdam:
        """For other rows: row i has row origin[i]'s moments, zero where it is fresh. All rows must
        be settled."""
        other = LazyAdam(len(origin), shares=self.shares, compiled=self.compiled)
        other.steps = self.steps
        other._settle_all()
        for name, moments in self._moments.items():
            first, second = (moment[origin] for moment in moments)
            first[fresh] = 0
            second[fresh] = 0
            other._moments[name] = first, second
        return other

    def state(self) -> dict[str, Tensor]:
        """The moments by name and the number of steps. All rows must be settled."""
        named = {"steps": torch.tensor(self.steps)}
        for name, (first, second) in self._moments.items():
            named |= {f"first.{name}": first, f"second.{name}": second}
        return named

    def load_state(self, state: Mapping[str, Tensor], values: Mapping[str, Tensor]) -> None:
        """Continue from a `state` of the moments of `values`. Raises ValueError for another one."""
        steps = int(tensor_like(state, "steps", torch.tensor(0)))
        if not 0 <= steps <= MOST_STEPS:
            raise ValueError(f"{steps} steps are none")
        names = [key.removeprefix("first.") for key in state if key.startswith("first.")]
        self._moments = {
            name: (
                tensor_like(state, f"first.{name}", values[name]),
                tensor_like(state, f"second.{name}", values[name]),
            )
            for name in names
        }
        self.steps = steps
        self._settle_all()
