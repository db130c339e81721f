"""Adam (Kingma and Ba 2015) over named tensors, in place: by a C++ kernel, or the same in torch."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from math import sqrt
from pathlib import Path
from typing import NamedTuple

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
MOST_STEPS = (1 << 31) - 1
"""Most steps that a state may tell of: a number beyond is damage."""


class Moving(NamedTuple):
    """A tensor and the running means of its gradient and of its gradient's square."""

    value: Float[Tensor, "n ..."]
    first: Float[Tensor, "n ..."]
    second: Float[Tensor, "n ..."]


def step(
    moving: Moving,
    gradient: Float[Tensor, "n ..."] | None,
    rate: float,
    bias_2: float,
    shares: Float[Tensor, "..."] | None = None,
    *,
    compiled: bool = False,
) -> None:
    """Apply one Adam step in place.

    At step t, `rate` = lr / (1 - b1^t) and `bias_2` = sqrt(1 - b2^t). Without a gradient, it is
    zero. `shares` are factors of the rate for each value of a row.
    """
    if compiled and _accepts(moving, gradient):
        return _run(moving, gradient, rate, bias_2, shares)
    value, first, second = moving
    if gradient is None:
        first *= BETA_1
        second *= BETA_2
    else:
        first.lerp_(gradient, 1 - BETA_1)
        second.mul_(BETA_2).addcmul_(gradient, gradient, value=1 - BETA_2)
    change = first if shares is None else first * shares.to(first)
    value.addcdiv_(change, second.sqrt().div_(bias_2).add_(EPSILON), value=-rate)


class _Job(ctypes.Structure):
    """Argument `Job` of adam.cpp."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ("value", "first", "second", "gradient", "shares")]
        + [(name, ctypes.c_int64) for name in ("count", "columns", "threads")]
        + [(name, ctypes.c_double) for name in ("beta_1", "beta_2", "epsilon", "rate", "bias_2")]
    )


def load() -> ctypes.CDLL | None:
    """The kernel; None where it cannot be compiled."""
    return load_library(SOURCE)


def _accepts(moving: Moving, gradient: Tensor | None) -> bool:
    """Whether the kernel may be called: it gets addresses, and reads and writes without a check."""
    value = moving.value
    parts = (*moving, *(() if gradient is None else (gradient,)))
    return (
        value.device.type == "cpu"
        and value.dtype in (torch.float32, torch.float64)
        and all(each.is_contiguous() for each in moving)
        and all((each.shape, each.dtype) == (value.shape, value.dtype) for each in parts)
        and load() is not None
    )


def _run(
    moving: Moving, gradient: Tensor | None, rate: float, bias_2: float, shares: Tensor | None
) -> None:
    kernel, value = load(), moving.value
    assert kernel is not None, "ask _accepts() first"
    # held until the kernel returns: it gets addresses only
    if shares is not None:
        shares = shares.to(value).expand(value.shape[1:])
    named = {**moving._asdict(), "gradient": gradient, "shares": shares}
    held = {name: each.contiguous() for name, each in named.items() if each is not None}
    job = _Job(
        count=len(value), columns=value.numel() // max(1, len(value)),
        threads=torch.get_num_threads(), beta_1=BETA_1, beta_2=BETA_2, epsilon=EPSILON,
        rate=rate, bias_2=bias_2, **{name: each.data_ptr() for name, each in held.items()},
    )  # fmt: skip
    if function(kernel, "step", value.dtype)(ctypes.byref(job)):
        raise MemoryError(f"no memory to move {len(value)} rows on {job.threads} threads")


class Adam:
    """The moments of named tensors, and the number of steps."""

    def __init__(
        self, *, shares: Mapping[str, Tensor] | None = None, compiled: bool = False
    ) -> None:
        """`shares`, by name: what the rate of each of a row's values is multiplied by, in a shape
        that broadcasts to a row's; 1 for names that are not there. `compiled`: steps by the C++
        kernel, where there is one; equal to rounding."""
        self.shares = shares or {}
        self.compiled = compiled
        self.steps = 0
        self._moments: dict[str, tuple[Tensor, Tensor]] = {}

    @torch.no_grad()
    def step(
        self,
        values: Mapping[str, Tensor],
        gradients: Mapping[str, Tensor],
        rates: Mapping[str, float],
    ) -> None:
        """Move `values`, in place, against their gradients; a name without one has a gradient of
        zero."""
        self.steps += 1
        bias_1, bias_2 = 1 - BETA_1**self.steps, sqrt(1 - BETA_2**self.steps)
        for name, rate in rates.items():
            gradient = gradients.get(name)
            if gradient is None and name not in self._moments:
                continue
            if name not in self._moments:
                zeros = torch.zeros_like(values[name])
                self._moments[name] = zeros, torch.zeros_like(zeros)
            moving = Moving(values[name].detach(), *self._moments[name])
            shares = self.shares.get(name)
            step(moving, gradient, rate / bias_1, bias_2, shares, compiled=self.compiled)

    def selected(self, origin: Int[Tensor, " m"], fresh: Bool[Tensor, " m"]) -> Adam:
        """For other rows: row i has row origin[i]'s moments, zero where it is fresh."""
        other = Adam(shares=self.shares, compiled=self.compiled)
        other.steps = self.steps
        for name, moments in self._moments.items():
            first, second = (moment[origin] for moment in moments)
            first[fresh] = 0
            second[fresh] = 0
            other._moments[name] = first, second
        return other

    def state(self) -> dict[str, Tensor]:
        """The moments by name and the number of steps."""
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
