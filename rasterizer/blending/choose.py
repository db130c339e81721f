"""Which implementation blends: the only place that decides."""

from __future__ import annotations

from rasterizer.blending import cpp_backend, torch_backend
from rasterizer.blending.backend import Backend
from rasterizer.numerics import Execution

BACKENDS: tuple[Backend, ...] = (cpp_backend.BACKEND, torch_backend.BACKEND)
"""In order of preference; the last accepts everything."""


def choose_backend(execution: Execution) -> Backend:
    """The first backend that accepts the execution."""
    return next(backend for backend in BACKENDS if backend.accepts(execution))
