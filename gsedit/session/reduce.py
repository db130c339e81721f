"""Make an edit smaller before it begins: bands, Gaussians and pixels that it does not need.

`n` Gaussians, `v` views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.fitting.update import COARSE_SIZE
from gsedit.savings.bands import needed_coefficients
from gsedit.savings.gaussians import faint_gaussians
from gsedit.savings.pictures import LOST, RESOLVED, footprint, lost
from gsedit.session.request import Request
from gsedit.views.dataset import View
from gsedit.views.kept import Kept
from gsedit.views.plan import ViewPlan
from rasterizer.camera import Camera
from rasterizer.numerics import Execution
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Reduction:
    """What an edit leaves out from its beginning."""

    scene: Gaussians
    """As it was read."""
    left: Bool[Tensor, " n"]
    """The Gaussians that the update leaves alone, though they are in the region."""
    full: tuple[int, int]
    """Width and height of the views as they were given."""
    footprint: float = 0.0
    """Of the median splat on them, pixels (see `gsedit.savings.pictures.footprint`)."""
    lost: float = 0.0
    """RMSE that views of half the size lack: of those that are used, or of those that were refused.
    0: no smaller size was tried."""

    def restored(self, edited: Gaussians) -> Gaussians:
        """The edited scene with everything that was left out of it, as it was read."""
        rest = self.scene.sh[:, edited.sh.shape[1] :]
        return replace(edited, sh=torch.cat((edited.sh, rest), 1)) if rest.shape[1] else edited


def nothing_left_out(request: Request) -> Reduction:
    """The whole scene, at the views' own size."""
    scene, camera = request.scene, request.views[0].camera
    left = torch.zeros(len(scene), dtype=torch.bool)
    return Reduction(scene, left, (camera.width, camera.height))


def reduce(
    request: Request, weights: Float[Tensor, "v n"], plan: ViewPlan
) -> tuple[Request, Reduction]:
    """The request as far as it is needed, and what was left out.

    `weights`: what each view sees of each Gaussian, in pixels of the survey's pictures.
    """
    scene, settings, reduction = request.scene, request.settings, nothing_left_out(request)
    shown = weights[list(plan.views)]
    if settings.leaves_out("gaussians"):
        used = weights if request.all_views else shown
        left = faint_gaussians(used / used.sum(1, keepdim=True).clamp_min(1e-9))
        reduction = replace(reduction, left=left)
    if settings.leaves_out("sh-bands"):
        kept = needed_coefficients(scene.sh, ~reduction.left)
        request = replace(request, scene=replace(scene, sh=scene.sh[:, :kept]))
    if settings.leaves_out("resolution"):
        return _smaller(request, shown, plan, reduction)
    return request, reduction


def _smaller(
    request: Request, shown: Float[Tensor, "v n"], plan: ViewPlan, reduction: Reduction
) -> tuple[Request, Reduction]:
    """The request with views halved as often as the splats allow, and what that loses."""
    cameras = [request.views[i].camera for i in plan.views]
    sizes = torch.tensor(
        [footprint(request.scene, camera, row) for camera, row in zip(cameras, shown)]
    )
    splat = float(sizes.median())
    reduction = replace(reduction, footprint=splat)
    least = max(COARSE_SIZE, request.settings.edit_size or 0)
    longer = max(cameras[0].width, cameras[0].height)
    execution = request.settings.execution
    factor, error, large = 1, 0.0, None
    while splat / factor >= RESOLVED and longer // (2 * factor) >= least:
        large = large or _pictures(request.scene, cameras, execution)
        smaller = [_divided(camera, 2 * factor) for camera in cameras]
        loss = lost(large, _pictures(request.scene, smaller, execution))
        if loss > LOST:
            error = error or loss
            break
        factor, error = 2 * factor, loss
    reduction = replace(reduction, lost=error)
    if factor == 1:
        return request, reduction
    shrink = partial(_shrunk, factor=factor, kept=Kept())
    views, held_out = (tuple(map(shrink, each)) for each in (request.views, request.held_out))
    return replace(request, views=views, held_out=held_out), reduction


@torch.no_grad()
def _pictures(
    scene: Gaussians, cameras: Sequence[Camera], execution: Execution
) -> list[Float[Tensor, "h w 3"]]:
    return [render(scene, camera, execution=execution).color for camera in cameras]


def _divided(camera: Camera, factor: int) -> Camera:
    """The camera with so many times fewer pixels a side."""
    return camera.resized(*(max(1, round(side / factor)) for side in (camera.width, camera.height)))


def _shrunk(view: View, factor: int, kept: Kept) -> View:
    camera = _divided(view.camera, factor)
    return kept.resized(view, camera.width, camera.height)


@torch.no_grad()
def marked_rendering(
    scene: Gaussians, camera: Camera, *, left: Bool[Tensor, " n"], execution: Execution
) -> Rendering:
    """A render of the unedited scene, with median depth, and where the Gaussians show that are
    left out."""
    marked = left if left.any() else None
    return render(scene, camera, median_depth=True, marked=marked, execution=execution)
