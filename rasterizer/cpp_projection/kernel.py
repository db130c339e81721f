"""The calls of `front.cpp`: see `compiled.py` for how it is compiled."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from math import inf, log
from pathlib import Path

import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from rasterizer import compiled
from rasterizer.blending.backend import GEOMETRY
from rasterizer.blending.cpp_backend import BACKEND
from rasterizer.camera import Camera
from rasterizer.numerics import Execution, Kernel, Numerics
from rasterizer.project import Box, near_plane, slope_limits
from rasterizer.scene import Gaussians
from rasterizer.tiles import Bins

SOURCE = Path(__file__).with_name("front.cpp")
FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")
REFUSED = -1
"""Code that front.cpp returns where a number is not finite."""


class _Job(ctypes.Structure):
    """Mirror of `Job` in job.h."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in FIELDS]
        + [(name, ctypes.c_int64) for name in ("count", "bands", "linear")]
        + [("pose", ctypes.c_double * 12)]
        + [(name, ctypes.c_double) for name in ("focal_x", "focal_y", "center_x", "center_y")]
        + [("slopes", ctypes.c_double * 4)]
        + [(name, ctypes.c_int64) for name in ("left", "top", "width", "height", "orthographic")]
        + [(name, ctypes.c_double) for name in
           ("near", "far", "blur", "alpha_min", "log_alpha_min", "least_logit", "radius_clip",
            "pair_overhead")]
        + [(name, ctypes.c_int64) for name in
           ("antialiased", "with_depth", "threads", "tile_size")]
        + [("scratch", ctypes.c_void_p), ("drawn", ctypes.c_int64)]
        + [(name, ctypes.c_void_p) for name in ("rows", "table", "depths", "centers", "shown")]
        + [(name, ctypes.c_int64) for name in ("pairs", "columns", "tile_rows")]
        + [(name, ctypes.c_void_p) for name in
           ("members", "slots", "starts", "firsts", "pair_gradients", "grad_centers",
            "grad_table")]
        + [("grad_columns", ctypes.c_int64)]
        + [(f"grad_{name}", ctypes.c_void_p) for name in FIELDS]
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Request:
    """Box of a picture to draw, and how to draw it."""

    camera: Camera
    box: Box
    numerics: Numerics
    execution: Execution
    depth: bool = False
    """Whether depth is blended, behind the colors."""
    median: bool = False
    linear: bool = False
    """Whether the fields are scales and opacities, and not their logarithms and logits."""


@dataclass(frozen=True, eq=False)
class Listed:
    """The `m` Gaussians of a scene that may touch the box, as a backend blends them."""

    request: Request
    rows: Int[Tensor, " m"]
    """Row numbers in the scene, ascending; int32."""
    table: Float[Tensor, "m g"]
    """Table that is blended: see `BlendInputs`."""
    depths: Float[Tensor, " m"] | None
    """For the median depth."""
    centers: Float[Tensor, "n 2"] | None
    """The table's first two columns by row of the scene; 0 for rows that are not here. None: not
    linear."""
    shown: UInt8[Tensor, " m"]
    """Bit c is set where channel c of the color is not clamped."""
    bins: Bins
    """Its slots are grouped by row of the table."""


_scratch: list[int] = []
"""Buffers that no call uses now."""


def load(kernel: Kernel = "auto") -> ctypes.CDLL | None:
    """The library, or None: see `compiled.load`. Raises RuntimeError as it does."""
    library = compiled.load(SOURCE, kernel)
    if library is not None and library.new_scratch.restype is not ctypes.c_void_p:
        library.new_scratch.restype = ctypes.c_void_p
        for name in ("cull", "project", "list", "sum", "backward"):
            for dtype in ("float32", "float64"):
                getattr(library, f"{name}_{dtype}").restype = ctypes.c_int64
    return library


def list_gaussians(scene: Gaussians, request: Request) -> Listed | None:
    """Cull, project, color and list by tile; None where an input or a footprint is not finite,
    which the Python files then name. Without harmonics the table has no colors.

    The scene's tensors are contiguous and of one dtype, float32 or float64. Raises MemoryError.
    """
    job = _job(scene, request)
    try:  # another thread may take the last one
        scratch = _scratch.pop()
    except IndexError:
        scratch = _library().new_scratch()
    if not scratch:
        raise MemoryError("no memory for a picture's lists")
    try:
        job.scratch = scratch
        return _listed(job, scene.means, request)
    finally:
        _scratch.append(scratch)


def _listed(job: _Job, like: Tensor, request: Request) -> Listed | None:
    job.drawn = count = _call("cull", job, like.dtype)
    if count == REFUSED:
        return None
    rows = like.new_empty(count, dtype=torch.int32)
    table = like.new_empty(count, GEOMETRY + (3 if job.bands else 0) + request.depth)
    depths = like.new_empty(count) if request.median else None
    centers = like.new_zeros(job.count, 2) if request.linear else None
    shown = like.new_empty(count, dtype=torch.uint8)
    firsts = like.new_empty(count, dtype=torch.int64)
    _point(job, rows=rows, table=table, depths=depths, centers=centers, shown=shown, firsts=firsts)
    if _call("project", job, like.dtype) == REFUSED:
        return None
    members, slots = firsts.new_empty(2, job.pairs)
    starts = firsts.new_empty(job.columns * job.tile_rows + 1)
    _point(job, members=members, slots=slots, starts=starts)
    _call("list", job, like.dtype)
    every = torch.arange(count, device=like.device)
    bins = Bins(members, starts, slots, firsts, every, job.tile_size, job.columns, job.tile_rows)
    return Listed(request, rows, table, depths, centers, shown, bins)


def table_gradients(
    listed: Listed, count: int, pairs: Float[Tensor, "p g"]
) -> tuple[Float[Tensor, "m g"], Float[Tensor, "n 2"]]:
    """Sums of the pairs' gradients: by row of a table, and its first two columns by row of the
    scene, which has `count`."""
    columns = pairs.shape[1]
    table, centers = pairs.new_empty(len(listed.rows), columns), pairs.new_zeros(count, 2)
    job = _Job(count=count, threads=torch.get_num_threads(), drawn=len(table), pairs=len(pairs),
               grad_columns=columns)  # fmt: skip
    _point(job, rows=listed.rows, firsts=listed.bins.firsts, pair_gradients=pairs,
           grad_table=table, grad_centers=centers)  # fmt: skip
    _call("sum", job, pairs.dtype)
    return table, centers


def scene_gradients(
    scene: Gaussians,
    listed: Listed,
    pairs: Float[Tensor, "p g"],
    firsts: Int[Tensor, " m"],
    centers: Float[Tensor, "n 2"] | None,
    wanted: tuple[bool, ...],
) -> tuple[Tensor | None, ...]:
    """Gradients of those of the scene's `FIELDS` that are wanted.

    `pairs` are gradients by rows of the table, of which row i's begin at firsts[i], and are added.
    Those of the positions, its first two columns, are in `centers` by row of the scene; None: here.
    """
    job = _job(scene, listed.request)
    fields = [getattr(scene, name) for name in FIELDS]
    gradients = [torch.empty_like(f) if w else None for f, w in zip(fields, wanted)]
    job.drawn, job.pairs = len(listed.rows), len(pairs)
    _point(
        job, rows=listed.rows, table=listed.table, shown=listed.shown, firsts=firsts,
        pair_gradients=pairs, grad_centers=centers,
        **{f"grad_{name}": g for name, g in zip(FIELDS, gradients)},
    )  # fmt: skip
    _call("backward", job, scene.means.dtype)
    return tuple(gradients)


def _job(scene: Gaussians, request: Request) -> _Job:
    camera, numerics = request.camera, request.numerics
    left, top, width, height = request.box
    floor = numerics.alpha_min
    # 1e-5: more than rounding takes, and what is kept is tested again
    least_logit = log(floor / (1 - floor)) - 1e-5 if 0 < floor < 1 else -inf
    if request.linear:
        least_logit = floor
    job = _Job(
        count=len(scene), bands=scene.sh.shape[1], linear=request.linear,
        pose=(ctypes.c_double * 12)(*camera.world_to_camera[:3].double().flatten().tolist()),
        focal_x=camera.fx, focal_y=camera.fy, center_x=camera.cx, center_y=camera.cy,
        slopes=(ctypes.c_double * 4)(*slope_limits(camera, numerics)),
        left=left, top=top, width=width, height=height,
        orthographic=camera.model == "ortho",
        near=near_plane(camera, numerics), far=numerics.far, blur=numerics.blur, alpha_min=floor,
        log_alpha_min=numerics.log_alpha_min, least_logit=least_logit,
        radius_clip=numerics.radius_clip, pair_overhead=BACKEND.pair_overhead,
        antialiased=numerics.antialiased, with_depth=request.depth,
        threads=torch.get_num_threads(), tile_size=request.execution.tile_size or 0,
    )  # fmt: skip
    _point(job, **{name: getattr(scene, name) for name in FIELDS})
    return job


def _point(job: _Job, **arrays: Tensor | None) -> None:
    """Set addresses by name. The caller holds the tensors until the kernel has returned."""
    for name, array in arrays.items():
        setattr(job, name, None if array is None else array.data_ptr())


def _library() -> ctypes.CDLL:
    library = load()
    assert library is not None, "ask load() first"
    return library


def _call(name: str, job: _Job, dtype: torch.dtype) -> int:
    """Call the kernel's `name` for a dtype. Raises MemoryError."""
    result = compiled.function(_library(), name, dtype)(ctypes.byref(job))
    if result < REFUSED:
        raise MemoryError(f"no memory to draw {job.count} Gaussians on {job.threads} threads")
    return result
