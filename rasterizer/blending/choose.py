"""Choice of the implementation that blends: the only place that decides."""

from __future__ import annotations

import torch

from rasterizer.blending import cpp_backend, torch_backend
from rasterizer.blending.backend import Backend
from rasterizer.numerics import Execution

BACKENDS: tuple[Backend, ...] = (cpp_backend.BACKEND, torch_backend.BACKEND)
"""In order of preference; the last accepts everything."""


def choose_backend(execution: Execution, device: torch.device, dtype: torch.dtype) -> Backend:
    """The first backend that accepts the execution, for tensors of that device and dtype.

    Raises RuntimeError where the compiled kernel is asked for and cannot be made.
    """
    return next(backend for backend in BACKENDS if backend.accepts(execution, device, dtype))


def is_compiled(execution: Execution) -> bool:
    """Whether the compiled kernel blends scenes in float32 on a CPU."""
    return choose_backend(execution, torch.device("cpu"), torch.float32) is cpp_backend.BACKEND
