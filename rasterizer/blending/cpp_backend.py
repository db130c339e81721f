"""The blending of `wavefront.py` as a C++ kernel, compiled once per machine and kept.

`kernel.cpp` has no dependencies: any C++17 compiler makes it in seconds. The result is cached by
the source, the compiler and the processor, under $XDG_CACHE_HOME/gsedit or ~/.cache/gsedit.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.batches import GEOMETRY
from rasterizer.numerics import Numerics
from rasterizer.tiles import Bins

SOURCE = Path(__file__).with_name("kernel.cpp")
FLAGS = ("-std=c++17", "-shared", "-fPIC", "-pthread", "-O3", "-fno-math-errno",
         "-fno-trapping-math", "-fopenmp-simd")  # fmt: skip
# No -ffast-math: linking with it would make the whole process flush denormals to zero.
FOR_THIS_PROCESSOR = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ())
"""Tried in this order: not every compiler knows every one."""

BLOCK = 16
"""As in kernel.cpp."""
PAIR_OVERHEAD = 120.0
"""As in wavefront.py; more, for here a pixel costs a tenth of what it costs there."""


class _Job(ctypes.Structure):
    """`Job` of kernel.cpp."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ("table", "members", "starts", "slots")]
        + [(name, ctypes.c_int64) for name in
           ("columns", "rows", "side", "width", "height", "depth", "threads")]
        + [(name, ctypes.c_double) for name in
           ("log_alpha_min", "log_alpha_max", "alpha_min", "stop")]
        + [(name, ctypes.c_void_p) for name in
           ("features", "light", "crossing", "visited", "blocks", "checkpoints",
            "grad_features", "grad_light", "gradients")]
    )  # fmt: skip


class Kept(NamedTuple):
    """What the backward pass needs, beside the transmittance."""

    visited: Int[Tensor, " t"]
    """Gaussians of each tile that were blended before it was opaque."""
    blocks: Int[Tensor, " t"]
    checkpoints: Float[Tensor, "n q"] | None
    """What light came in to each block of a tile; None: no gradient is wanted."""


def forward(
    table: Float[Tensor, "m g"], bins: Bins, width: int, height: int, numerics: Numerics,
    median: bool, *, differentiate: bool,
) -> tuple[Tensor, Tensor, Tensor | None, Kept]:  # fmt: skip
    """Features [h w d], transmittance [h w] and crossing [h w] or None.

    Only where `load` gives a kernel.
    """
    features = table.new_empty(height, width, table.shape[1] - GEOMETRY)
    light = table.new_empty(height, width)
    crossing = torch.empty(height, width, dtype=torch.long) if median else None
    blocks = (bins.starts.diff() + BLOCK - 1) // BLOCK
    total, first = int(blocks.sum()), blocks.cumsum(0) - blocks
    checkpoints = table.new_empty(total, bins.size**2) if differentiate else None
    kept = Kept(torch.empty_like(first), first, checkpoints)
    _run("forward", table, bins, width, height, numerics, features=features, light=light,
         crossing=crossing, **kept._asdict())  # fmt: skip
    return features, light, crossing, kept


def backward(
    table: Float[Tensor, "m g"], bins: Bins, width: int, height: int, numerics: Numerics,
    kept: Kept, light: Float[Tensor, "h w"],
    grad_features: Float[Tensor, "h w d"], grad_light: Float[Tensor, "h w"],
) -> Float[Tensor, "p g"]:  # fmt: skip
    """Gradients of every (tile, Gaussian) pair, at its slot."""
    gradients = table.new_zeros(len(bins.members), table.shape[1])
    _run("backward", table, bins, width, height, numerics, light=light, **kept._asdict(),
         grad_features=grad_features, grad_light=grad_light, gradients=gradients)  # fmt: skip
    return gradients


def _run(
    name: str, table: Tensor, bins: Bins, width: int, height: int, numerics: Numerics,
    **arrays: Tensor | None,
) -> None:  # fmt: skip
    kernel = load()
    assert kernel is not None, "ask load() first"
    held = {"table": table.contiguous(), "members": bins.members, "starts": bins.starts,
            "slots": bins.slots, **arrays}  # fmt: skip
    job = _Job(
        columns=bins.columns, rows=bins.rows, side=bins.size, width=width, height=height,
        depth=table.shape[1] - GEOMETRY, threads=torch.get_num_threads(),
        log_alpha_min=numerics.log_alpha_min, log_alpha_max=numerics.log_alpha_max,
        alpha_min=numerics.alpha_min, stop=numerics.transmittance_min,
        **{key: value.data_ptr() for key, value in held.items() if value is not None},
    )  # fmt: skip
    run = getattr(kernel, f"{name}_{str(table.dtype).removeprefix('torch.')}")
    if run(ctypes.byref(job)):
        raise MemoryError(f"no memory for tiles of {bins.size} pixels on {job.threads} threads")


@functools.cache
def load() -> ctypes.CDLL | None:
    """The kernel, compiled if it is not in the cache; None, with a warning, where that fails."""
    names = (os.environ.get("CXX"),) if "CXX" in os.environ else ("c++", "g++", "clang++")
    compiler = next((found for name in names if name and (found := shutil.which(name))), None)
    try:
        if compiler is None:
            raise _Failed(f"no C++ compiler was found ({', '.join(map(str, names))})")
        try:
            return ctypes.CDLL(str(_kept(compiler)))
        except OSError:  # nowhere to keep it, or what was kept does not load
            with tempfile.TemporaryDirectory() as folder:
                return ctypes.CDLL(str(_compile(compiler, Path(folder) / "kernel.so")))
    except (_Failed, OSError) as error:
        warnings.warn(
            f"{error}: going on without the compiled kernel (the same picture, slower). "
            "Install g++ or clang++, or name a C++17 compiler in CXX.",
            stacklevel=2,
        )
        return None


class _Failed(Exception):
    """There is no kernel; why."""


def _kept(compiler: str) -> Path:
    """The kernel's place in the cache, where it now is."""
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:  # nobody's home
        raise OSError(*error.args) from error
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    key = "\n".join(
        (
            SOURCE.read_text(),
            compiler,
            version.stdout,
            *FLAGS,
            str(FOR_THIS_PROCESSOR),
            _processor(),
        )
    )
    place = Path(base) / "gsedit" / f"kernel-{hashlib.sha256(key.encode()).hexdigest()[:16]}.so"
    if place.exists():
        return place
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent) as folder:  # so that it appears whole
        return _compile(compiler, Path(folder) / place.name).replace(place)


def _processor() -> str:
    """What -march=native depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    found = {line for line in lines if line.startswith(("model name", "flags", "Features"))}
    return "\n".join((*sorted(found), platform.platform(), platform.processor()))


def _compile(compiler: str, target: Path) -> Path:
    complaint = ""
    for tuning in FOR_THIS_PROCESSOR:
        command = [compiler, *FLAGS, *tuning, str(SOURCE), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return target
        complaint = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
    raise _Failed(f"{compiler} could not compile {SOURCE.name} ({complaint})")
