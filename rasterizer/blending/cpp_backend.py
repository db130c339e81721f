"""Blending as a C++ kernel, `kernel.cpp`: see `compiled.py` for how it is compiled."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from rasterizer import compiled
from rasterizer.blending.backend import GEOMETRY, Backend, Blended, BlendInputs, ForwardPass
from rasterizer.numerics import Execution, Kernel

SOURCE = Path(__file__).with_name("kernel.cpp")


class _Job(ctypes.Structure):
    """Mirror of `Job` in chunk.h."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ("table", "members", "starts", "slots")]
        + [(name, ctypes.c_int64) for name in
           ("columns", "rows", "side", "width", "height", "depth", "threads")]
        + [(name, ctypes.c_double) for name in
           ("log_alpha_min", "log_alpha_max", "stop", "least")]
        + [(name, ctypes.c_void_p) for name in
           ("features", "transmittance", "median_index", "ends", "grad_features",
            "grad_transmittance", "wanted", "gradients")]
    )  # fmt: skip


class _Saved(NamedTuple):
    """State that the backward pass needs."""

    inputs: BlendInputs
    ends: Int[Tensor, "h w"] | None
    """Place in its tile's list at which each pixel was finished; None: no gradient is wanted."""


def forward(inputs: BlendInputs, median: bool, differentiate: bool) -> ForwardPass:
    """`Backend.forward`. Only where `load` gives a kernel."""
    table, bins, shape = inputs.table, inputs.bins, (inputs.height, inputs.width)
    features = table.new_empty(*shape, table.shape[1] - GEOMETRY)
    transmittance = table.new_empty(shape)
    median_index = bins.members.new_empty(shape) if median else None
    ends = table.new_empty(shape, dtype=torch.int32) if differentiate else None
    blended = Blended(features, transmittance, median_index)
    _run("forward", inputs, **blended._asdict(), ends=ends)
    return ForwardPass(blended, _Saved(inputs, ends))


def backward(
    saved: _Saved,
    transmittance: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"],
    grad_transmittance: Float[Tensor, "h w"],
) -> Float[Tensor, "m g"]:
    """Gradient by the table: see `Backend.backward`."""
    bins = saved.inputs.bins
    pairs = pair_gradients(saved, transmittance, grad_features, grad_transmittance)
    # each Gaussian's pairs, tile by tile: the same sum on every run
    by_rank = embedding_bag(torch.arange(len(pairs)), pairs, bins.firsts, mode="sum")
    return by_rank.index_select(0, bins.rank)


def pair_gradients(
    saved: _Saved,
    transmittance: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"],
    grad_transmittance: Float[Tensor, "h w"],
) -> Float[Tensor, "p g"]:
    """The loss's gradients by every pair's row of the table, each at its slot (see `Bins.slots`).

    `saved` is `forward`'s; see `Backend.backward`.
    """
    inputs = saved.inputs
    gradients = inputs.table.new_empty(len(inputs.bins.members), inputs.table.shape[1])
    _run("backward", inputs, transmittance=transmittance, ends=saved.ends,
         grad_features=grad_features, grad_transmittance=grad_transmittance,
         gradients=gradients)  # fmt: skip
    return gradients


def pull(inputs: BlendInputs, maps: Float[Tensor, "h w 3"]) -> Float[Tensor, "m 3"]:
    """`Backend.pull`: one pass from front to back, without gradients of the geometry."""
    bins = inputs.bins
    pairs = inputs.table.new_empty(len(bins.members), 3)
    _run("pull", inputs, grad_features=maps, gradients=pairs)
    by_rank = embedding_bag(torch.arange(len(pairs)), pairs, bins.firsts, mode="sum")
    return by_rank.index_select(0, bins.rank)


def _run(name: str, inputs: BlendInputs, **arrays: Tensor | None) -> None:
    """Call the kernel's `name` for the table's dtype; arrays by the names that `_Job` has.

    Raises MemoryError where the kernel has no memory for its buffers.
    """
    kernel = load()
    assert kernel is not None, "ask load() first"
    bins, numerics = inputs.bins, inputs.numerics
    table = inputs.table.contiguous()
    wanted = None if inputs.wanted is None else inputs.wanted.to(table).contiguous()
    if wanted is not None and wanted.shape != (inputs.height, inputs.width):
        raise ValueError(f"wanted pixels are {tuple(wanted.shape)}, the picture's are not")
    # held until the kernel returns: it gets addresses only
    held = {"table": table, "members": bins.members, "starts": bins.starts,
            "slots": bins.slots, "wanted": wanted, **arrays}  # fmt: skip
    job = _Job(
        columns=bins.columns, rows=bins.rows, side=bins.size,
        width=inputs.width, height=inputs.height,
        depth=table.shape[1] - GEOMETRY, threads=torch.get_num_threads(),
        log_alpha_min=numerics.log_alpha_min, log_alpha_max=numerics.log_alpha_max,
        stop=numerics.transmittance_min, least=numerics.gradient_min,
        **{key: value.data_ptr() for key, value in held.items() if value is not None},
    )  # fmt: skip
    if compiled.function(kernel, name, table.dtype)(ctypes.byref(job)):
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
    pull=pull,
    # a pixel costs next to nothing, for a tile's pixels are visited only where an ellipse is; but
    # tiles above 16 pixels are blended in parts, each of which reads the whole list
    pair_overhead=320.0,
)
