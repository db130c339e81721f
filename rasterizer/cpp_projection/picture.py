"""A scene's picture by the compiled front end and the compiled blending."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import checks
from rasterizer.blending.backend import GEOMETRY, Blended, BlendInputs, refuse_second_derivatives
from rasterizer.blending.choose import choose_backend
from rasterizer.blending.cpp_backend import BACKEND, pair_gradients
from rasterizer.camera import Camera
from rasterizer.cpp_projection import kernel
from rasterizer.numerics import Execution, Numerics
from rasterizer.project import Box, near_plane
from rasterizer.scene import Gaussians
from rasterizer.splat import composite

BY_PAIR = replace(BACKEND, backward=pair_gradients)
"""The blending, whose gradients the front end adds up itself."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """Gaussians that may touch a box of pixels, listed by tile; differentiable in the scene."""

    listed: kernel.Listed
    pairs: Float[Tensor, "p g"]
    """Stand-in for every pair's row of the table, which takes gradients."""
    table: Float[Tensor, "m g"]
    """Table that is blended; of its first two columns it takes no gradient."""
    centers: Float[Tensor, "n 2"] | None
    """These take gradients: see `Listed.centers`."""

    def picture(
        self, centers: Float[Tensor, "n 2"], features: Float[Tensor, "m d"] | None
    ) -> Blended:
        """Blend the table, with features behind the geometry; positions, which are equal to the
        table's own, take their gradient."""
        table = self.table
        if features is not None:
            geometry, last = table.tensor_split((GEOMETRY,), -1)
            table = torch.cat((geometry, features, last), -1)
        return self.blended(table, _Placed.apply(table, centers, self.listed))

    def blended(
        self, table: Float[Tensor, "m g"], pairs: Float[Tensor, "p g"], *, median: bool = False
    ) -> Blended:
        """Blend a table of these Gaussians, whose pairs take the gradient."""
        request = self.listed.request
        _, _, width, height = request.box
        inputs = BlendInputs(table, self.listed.bins, width, height, request.numerics)
        return composite(inputs, BY_PAIR, pairs, median=median)


def draw(
    scene: Gaussians,
    camera: Camera,
    box: Box,
    numerics: Numerics,
    execution: Execution,
    *,
    depth: bool = False,
    median: bool = False,
) -> tuple[Blended, Float[Tensor, " m"] | None, Int[Tensor, " m"]] | None:
    """Draw a box of a camera's pixels, color and then depth where it is asked for; differentiable
    in the scene. Also the depths, for a median, and the rows in the scene of what median indices
    name.

    None where the Python files have to do it: without a compiler or for options that the kernel
    does not have, for a pose that takes gradients, and where a number is not finite, which they
    name. Raises ValueError for a camera, a box or a setting that is not usable.
    """
    request = kernel.Request(camera, box, numerics, execution, depth, median)
    found = prepare(scene, request) if scene.sh.shape[1] else None
    if found is None:
        return None
    blended = found.blended(found.table, found.pairs, median=median)
    return blended, found.listed.depths, found.listed.rows


def prepare(scene: Gaussians, request: kernel.Request) -> Prepared | None:
    """The Gaussians that a request may show. Without harmonics their table has no colors.

    None, and ValueError, as for `draw`.
    """
    if not _fits(scene, request):
        return None
    checks.settings(request.numerics)
    checks.camera(request.camera)
    checks.crop(request.box, request.camera)
    # the backward pass reads the pose again, which may have been changed in place by then
    pose = request.camera.world_to_camera.detach().clone()
    request = replace(request, camera=replace(request.camera, world_to_camera=pose))
    found = _Prepared.apply(request, *(getattr(scene, name) for name in kernel.FIELDS))
    return None if found is None else Prepared(*found)


def _fits(scene: Gaussians, request: kernel.Request) -> bool:
    """Whether the kernel can draw it; inputs that are wrong are for the Python files to name."""
    camera, execution, numerics = request.camera, request.execution, request.numerics
    means, count = scene.means, len(scene)
    fields = [getattr(scene, name) for name in kernel.FIELDS]
    alike = all(f.dtype == means.dtype and f.device == means.device for f in fields)
    bands = scene.sh.shape[1] if scene.sh.ndim == 3 else 0
    shapes = [(count, 3), (count, 4), (count, 3), (count,), (count, bands, 3)]
    return (
        choose_backend(execution, means.device, means.dtype) is BACKEND
        and alike
        and [tuple(f.shape) for f in fields] == shapes  # it reads addresses
        and camera.world_to_camera.shape == (4, 4)
        and bands in (0, 1, 4, 9, 16, 25)
        and count < 1 << 31
        and not (torch.is_grad_enabled() and camera.world_to_camera.requires_grad)
        and numerics.alpha_min > 0
        and not (camera.model == "pinhole" and near_plane(camera, numerics) < 0)
        and kernel.load(execution.kernel) is not None
    )


class _Prepared(torch.autograd.Function):
    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def forward(  # type: ignore[override]
        ctx: Any, request: kernel.Request, *fields: Tensor
    ) -> tuple[kernel.Listed, Tensor, Tensor, Tensor | None] | None:
        fields = tuple(field.detach().contiguous() for field in fields)
        listed = kernel.list_gaussians(Gaussians(*fields), request)
        if listed is None:
            return None
        ctx.set_materialize_grads(False)
        ctx.listed = listed
        ctx.save_for_backward(*fields)
        pairs, centers = _rows_of_pairs(listed, listed.table), listed.centers
        # outputs themselves in ctx would make a cycle
        return listed, pairs, listed.table.detach(), None if centers is None else centers.detach()

    @staticmethod
    @torch.autocast("cpu", enabled=False)
    def backward(  # type: ignore[override]
        ctx: Any,
        _: Any,
        by_pair: Float[Tensor, "p g"] | None,
        by_table: Float[Tensor, "m g"] | None,
        by_center: Float[Tensor, "n 2"] | None,
    ) -> tuple[Tensor | None, ...]:
        refuse_second_derivatives()
        listed, firsts = ctx.listed, ctx.listed.bins.firsts
        if by_pair is None:  # then each row of the table has one
            by_pair = torch.zeros_like(listed.table) if by_table is None else by_table.contiguous()
            firsts = listed.bins.rank
        scene, wanted = Gaussians(*ctx.saved_tensors), ctx.needs_input_grad[1:]
        by_center = None if by_center is None else by_center.contiguous()
        return None, *kernel.scene_gradients(scene, listed, by_pair, firsts, by_center, wanted)


class _Placed(torch.autograd.Function):
    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any, table: Float[Tensor, "m g"], centers: Float[Tensor, "n 2"], listed: kernel.Listed
    ) -> Float[Tensor, "p g"]:
        ctx.listed, ctx.count = listed, len(centers)
        return _rows_of_pairs(listed, table)

    @staticmethod
    def backward(ctx: Any, by_pair: Float[Tensor, "p g"]) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        return *kernel.table_gradients(ctx.listed, ctx.count, by_pair.contiguous()), None


def _rows_of_pairs(listed: kernel.Listed, table: Float[Tensor, "m g"]) -> Float[Tensor, "p g"]:
    """Stand-in for every pair's row of a table, by slot: takes gradients, and holds no numbers."""
    return table.new_empty(()).expand(len(listed.bins.members), table.shape[1])
