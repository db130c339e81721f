"""Blending as a C++ kernel, `kernel.cpp`: see `compiled.py` for how it is compiled."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import compiled
from rasterizer.blending.backend import GEOMETRY, Backend, Blended, BlendInputs, ForwardPass
from rasterizer.numerics import Execution, Kernel

SOURCE = Path(__file__).with_name("kernel.cpp")
BLOCK = 16
"""As in kernel.cpp."""


class _Job(ctypes.Structure):
    """`Job` of kernel.cpp."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ("table", "members", "starts", "slots")]
        + [(name, ctypes.c_int64) for name in
           ("columns", "rows", "side", "width", "height", "depth", "threads")]
        + [(name, ctypes.c_double) for name in
           ("log_alpha_min", "log_alpha_max", "alpha_min", "stop")]
        + [(name, ctypes.c_void_p) for name in
           ("features", "transmittance", "median_index", "visited", "blocks", "checkpoints",
            "grad_features", "grad_transmittance", "gradients")]
    )  # fmt: skip


class _Checkpoints(NamedTuple):
    """How far each tile was blended."""

    visited: Int[Tensor, " t"]
    """Gaussians of each tile that were blended before it was opaque."""
    blocks: Int[Tensor, " t"]
    """Where each tile's blocks begin among all blocks."""
    checkpoints: Float[Tensor, "n q"] | None
    """Transmittance in front of each block; None: no gradient is wanted."""


class _Saved(NamedTuple):
    """What the backward pass needs."""

    inputs: BlendInputs
    checkpoints: _Checkpoints


def forward(inputs: BlendInputs, median: bool, differentiate: bool) -> ForwardPass:
    """`Backend.forward`. Only where `load` gives a kernel."""
    table, bins, shape = inputs.table, inputs.bins, (inputs.height, inputs.width)
    features = table.new_empty(*shape, table.shape[1] - GEOMETRY)
    transmittance = table.new_empty(shape)
    median_index = bins.members.new_empty(shape) if median else None
    blocks = (bins.starts.diff() + BLOCK - 1) // BLOCK
    total, first = int(blocks.sum()), blocks.cumsum(0) - blocks
    planes = table.new_empty(total, bins.size**2) if differentiate else None
    checkpoints = _Checkpoints(torch.empty_like(first), first, planes)
    blended = Blended(features, transmittance, median_index)
    _run("forward", inputs, **blended._asdict(), **checkpoints._asdict())
    return ForwardPass(blended, _Saved(inputs, checkpoints))


def backward(
    saved: _Saved,
    transmittance: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"],
    grad_transmittance: Float[Tensor, "h w"],
) -> Float[Tensor, "p g"]:
    """`Backend.backward`."""
    inputs = saved.inputs
    gradients = inputs.table.new_zeros(len(inputs.bins.members), inputs.table.shape[1])
    _run("backward", inputs, transmittance=transmittance, **saved.checkpoints._asdict(),
         grad_features=grad_features, grad_transmittance=grad_transmittance,
         gradients=gradients)  # fmt: skip
    return gradients


def _run(name: str, inputs: BlendInputs, **arrays: Tensor | None) -> None:
    """Call the kernel's `name` for the table's dtype; arrays by the names that `_Job` has.

    Raises MemoryError where the kernel has no memory for its buffers.
    """
    kernel = load()
    assert kernel is not None, "ask load() first"
    bins, numerics = inputs.bins, inputs.numerics
    table = inputs.table.contiguous()
    # held until the kernel returns: it gets addresses only
    held = {"table": table, "members": bins.members, "starts": bins.starts,
            "slots": bins.slots, **arrays}  # fmt: skip
    job = _Job(
        columns=bins.columns, rows=bins.rows, side=bins.size,
        width=inputs.width, height=inputs.height,
        depth=table.shape[1] - GEOMETRY, threads=torch.get_num_threads(),
        log_alpha_min=numerics.log_alpha_min, log_alpha_max=numerics.log_alpha_max,
        alpha_min=numerics.alpha_min, stop=numerics.transmittance_min,
        **{key: value.data_ptr() for key, value in held.items() if value is not None},
    )  # fmt: skip
    run = getattr(kernel, f"{name}_{str(table.dtype).removeprefix('torch.')}")
    if run(ctypes.byref(job)):
        raise MemoryError(f"no memory for tiles of {bins.size} pixels on {job.threads} threads")


def load(kernel: Kernel = "auto") -> ctypes.CDLL | None:
    """The kernel that `Execution.kernel` asks for, as `compiled.load`."""
    return compiled.load(SOURCE, kernel)


def accepts(execution: Execution, device: torch.device, dtype: torch.dtype) -> bool:
    """`Backend.accepts`. Compiles only for what it can blend."""
    fits = device.type == "cpu" and dtype in (torch.float32, torch.float64)
    return fits and load(execution.kernel) is not None


BACKEND = Backend(
    name="cpp",
    accepts=accepts,
    forward=forward,
    backward=backward,
    # as the torch backend's; more, for here a pixel costs a tenth of what it costs there
    pair_overhead=120.0,
)
