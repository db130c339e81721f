"""A scene's picture by the compiled front end and the compiled blending, as one operation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer import checks
from rasterizer.blending.backend import (
    GEOMETRY,
    Backend,
    BlendInputs,
    median_depths,
    refuse_second_derivatives,
)
from rasterizer.blending.choose import choose_backend
from rasterizer.blending.cpp_backend import pair_gradients
from rasterizer.camera import Camera
from rasterizer.cpp_projection import kernel
from rasterizer.numerics import Execution, Numerics
from rasterizer.preprocess import Splats
from rasterizer.project import Box, Projected, covariance_of, near_plane
from rasterizer.scene import Gaussians


class Drawn(NamedTuple):
    """Blended rectangle of pixels, over black."""

    features: Float[Tensor, "h w d"]
    """Color, then depth where it was asked for."""
    transmittance: Float[Tensor, "h w"]
    median_depth: Float[Tensor, "h w"] | None


def draw(
    scene: Gaussians,
    camera: Camera,
    box: Box,
    numerics: Numerics,
    execution: Execution,
    *,
    depth: bool = False,
    median: bool = False,
) -> Drawn | None:
    """Draw a box of a camera's pixels; differentiable in the scene.

    None where the Python files have to do it: without a compiler or for options that the kernel
    does not have, for a pose that takes gradients, and where a number is not finite, which they
    name. Raises ValueError for a camera, a box or a setting that is not usable.
    """
    backend = choose_backend(execution, scene.means.device, scene.means.dtype)
    if not _fits(scene, camera, numerics, execution, backend, least_bands=1):
        return None
    request = _request(camera, box, numerics, execution, backend, depth, median)
    fields = [getattr(scene, name) for name in kernel.FIELDS]
    drawn = _Picture.apply(request, backend, *fields)
    return None if drawn is None else Drawn(*drawn)


def prepare(
    scene: Gaussians, camera: Camera, box: Box, numerics: Numerics, execution: Execution
) -> Splats | None:
    """The Gaussians that may touch a box of a camera's pixels, listed by tile; differentiable.

    `scene` holds scales and opacities where others hold logarithms and logits; without harmonics
    the splats have no colors. None, and ValueError, as for `draw`.
    """
    backend = choose_backend(execution, scene.means.device, scene.means.dtype)
    if not _fits(scene, camera, numerics, execution, backend, least_bands=0):
        return None
    request = _request(camera, box, numerics, execution, backend, depth=True, median=False)
    fields = [getattr(scene, name) for name in kernel.FIELDS]
    found = _Prepared.apply(replace(request, linear=True), *fields)
    if found is None:
        return None
    table, listed = found
    # split, not sliced: one gradient of the table and not five
    channels = table.shape[1] - GEOMETRY - 1
    xy, whitening, log_opacities, colors, depth = table.split((2, 3, 1, channels, 1), -1)
    projected = Projected(
        xy=xy + xy.new_tensor(box[:2]),
        whitening=whitening,
        depth=depth[:, 0],
        sort_depth=depth[:, 0].detach(),
        covariance=covariance_of(whitening),
    )
    known = colors if channels else None
    return Splats(listed.rows.long(), projected, log_opacities[:, 0], known, listed.bins)


def _request(
    camera: Camera,
    box: Box,
    numerics: Numerics,
    execution: Execution,
    backend: Backend,
    depth: bool,
    median: bool,
) -> kernel.Request:
    """Checked inputs of the kernel; raises ValueError where they are not usable."""
    checks.settings(numerics)
    checks.camera(camera)
    checks.crop(box, camera)
    # the backward pass reads the pose again, which may have been changed in place by then
    camera = replace(camera, world_to_camera=camera.world_to_camera.detach().clone())
    return kernel.Request(camera, box, numerics, execution, backend.pair_overhead, depth, median)


def _fits(
    scene: Gaussians,
    camera: Camera,
    numerics: Numerics,
    execution: Execution,
    backend: Backend,
    least_bands: int,
) -> bool:
    """Whether the kernel can draw it; inputs that are wrong are for the Python files to name."""
    means, count = scene.means, len(scene)
    fields = [getattr(scene, name) for name in kernel.FIELDS]
    alike = all(f.dtype == means.dtype and f.device == means.device for f in fields)
    bands = scene.sh.shape[1] if scene.sh.ndim == 3 else 0
    shapes = [(count, 3), (count, 4), (count, 3), (count,), (count, bands, 3)]
    return (
        backend.name == "cpp"
        and alike
        and [tuple(f.shape) for f in fields] == shapes  # it reads addresses
        and camera.world_to_camera.shape == (4, 4)
        and bands in (0, 1, 4, 9, 16, 25)
        and bands >= least_bands
        and count < 1 << 31
        and not (torch.is_grad_enabled() and camera.world_to_camera.requires_grad)
        and execution.cull == "ellipse"
        and numerics.alpha_min > 0
        and not (camera.model == "pinhole" and near_plane(camera, numerics) < 0)
        and kernel.load(execution.kernel) is not None
    )


class _Prepared(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any, request: kernel.Request, *fields: Tensor
    ) -> tuple[Tensor, kernel.Listed] | None:
        fields = tuple(field.detach().contiguous() for field in fields)
        listed = kernel.list_gaussians(Gaussians(*fields), request)
        if listed is None:
            return None
        ctx.listed = listed
        ctx.save_for_backward(*fields)
        return listed.table.detach(), listed  # the output itself in ctx would make a cycle

    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def backward(ctx: Any, upstream: Float[Tensor, "m g"], _: Any) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        refuse_second_derivatives()
        scene, upstream = Gaussians(*ctx.saved_tensors), upstream.contiguous()
        each, wanted = ctx.listed.bins.rank, ctx.needs_input_grad[1:]  # a row of each
        return None, *kernel.scene_gradients(scene, ctx.listed, upstream, each, wanted)


class _Picture(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any, request: kernel.Request, backend: Backend, *fields: Tensor
    ) -> tuple[Tensor, Tensor, Tensor | None] | None:
        fields = tuple(field.detach().contiguous() for field in fields)
        listed = kernel.list_gaussians(Gaussians(*fields), request)
        if listed is None:
            return None
        _, _, width, height = request.box
        block = request.execution.block
        inputs = BlendInputs(listed.table, listed.bins, width, height, request.numerics, block)
        differentiate = any(ctx.needs_input_grad[2:])
        blended, ctx.blending = backend.forward(inputs, request.median, differentiate)
        ctx.listed = listed
        ctx.save_for_backward(blended.transmittance, *fields)
        median = None
        if blended.median_index is not None and listed.depths is not None:
            median = median_depths(listed.depths, blended.median_index)
            ctx.mark_non_differentiable(median)
        return blended.features, blended.transmittance, median

    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def backward(  # type: ignore[override]
        ctx: Any,
        grad_features: Float[Tensor, "h w d"],
        grad_transmittance: Float[Tensor, "h w"],
        _: Any,
    ) -> tuple[Tensor | None, ...]:
        refuse_second_derivatives()
        transmittance, *fields = ctx.saved_tensors
        pairs = pair_gradients(
            ctx.blending, transmittance, grad_features.contiguous(), grad_transmittance.contiguous()
        )
        wanted = ctx.needs_input_grad[2:]
        scene = Gaussians(*fields)
        firsts = ctx.listed.bins.firsts
        return None, None, *kernel.scene_gradients(scene, ctx.listed, pairs, firsts, wanted)
