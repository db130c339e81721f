"""Renders of the unedited scene at the views of an edit: the one cache of them."""

from __future__ import annotations

from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.request import Request
from gsedit.select.region import Region, coverage
from gsedit.views.image_ops import downscale
from rasterizer.camera import Camera
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians


class UneditedRenders:
    """Cache of what the unedited scene looks like; each render is made when it is first asked for.

    Indices are into `Request.every_view`.
    """

    def __init__(self, request: Request) -> None:
        self.request = request
        self._renderings: dict[tuple[int, int], Rendering] = {}
        self._coverages: dict[int, tuple[Region, Float[Tensor, "h w"]]] = {}

    def rendering(self, i: int) -> Rendering:
        """The render of view i, with median depth."""
        return self._rendering(i, self.request.every_view[i].camera)

    def _rendering(self, i: int, camera: Camera) -> Rendering:
        key = i, camera.width
        if key not in self._renderings:
            self._renderings[key] = self._render(camera)
        return self._renderings[key]

    def picture(self, i: int) -> Float[Tensor, "h w 3"]:
        """The picture of view i, in [0, 1]."""
        return self.rendering(i).color.clamp(0, 1)

    def edit_camera(self, i: int) -> Camera:
        """View i's camera at the size at which it is edited, see `EditSettings.edit_size`."""
        return edit_camera(self.request.every_view[i].camera, self.request.settings.edit_size)

    def edit_rendering(self, i: int) -> Rendering:
        """The render of view i at the size at which it is edited, with median depth."""
        return self._rendering(i, self.edit_camera(i))

    def edit_condition(self, i: int) -> Float[Tensor, "y x 3"]:
        """The picture of `condition` at the size at which it is edited; a photo is not enlarged."""
        camera, own = self.edit_camera(i), self.request.every_view[i].camera
        if camera.width > own.width:
            return self._on_backdrop(self.edit_rendering(i))
        return downscale(self.condition(i), camera.width, camera.height).clamp(0, 1)

    def condition(self, i: int) -> Float[Tensor, "h w 3"]:
        """The picture that the editor is shown as the unedited view i, in [0, 1].

        Where a photo is masked, the render is shown: an edited picture has no hole.
        """
        rendered = self.rendering(i).color
        if self.request.settings.condition != "photo":
            return self._on_backdrop(self.rendering(i))
        view = self.request.every_view[i]
        picture = view.image.to(rendered)
        if view.mask is not None:
            picture = torch.where(view.mask[..., None], picture, rendered)
        return picture.clamp(0, 1)

    def _on_backdrop(self, rendering: Rendering) -> Float[Tensor, "h w 3"]:
        """A picture in [0, 1]. For editors that draw, the scene's mean color is where nothing is:
        black would be an edge to paint, and most of what a small object is normalised by."""
        picture = rendering.color.clamp(0, 1)
        if not self.request.editor.capabilities.draws:
            return picture
        return picture + (1 - rendering.alpha.clamp(0, 1))[..., None] * self._mean_color

    @cached_property
    def _mean_color(self) -> Float[Tensor, "3"]:
        """The mean color of what the first view shows; black where it shows nothing."""
        shown = self.rendering(0)
        return shown.color.clamp(0, 1).sum((0, 1)) / shown.alpha.sum().clamp_min(1e-6)

    def coverage(self, region: Region, i: int) -> Float[Tensor, "h w"]:
        """The region's share of each pixel of view i, in [0, 1]; kept for the last region."""
        known = self._coverages.get(i)
        if known is None or known[0] is not region:
            request, camera = self.request, self.request.every_view[i].camera
            share = coverage(region, request.scene, camera)
            known = self._coverages[i] = (region, share)
        return known[1]

    def _render(self, camera: Camera) -> Rendering:
        return render_with_depth(self.request.whole, camera)


@torch.no_grad()
def render_with_depth(scene: Gaussians, camera: Camera) -> Rendering:
    """A render without gradients, with median depth."""
    return render(scene, camera, median_depth=True)


def edit_camera(camera: Camera, edit_size: int | None) -> Camera:
    """The camera at the size at which its view is edited; itself where that is its own size."""
    longest = max(camera.width, camera.height)
    if edit_size is None or edit_size == longest:
        return camera
    width, height = (
        max(1, round(side * edit_size / longest)) for side in (camera.width, camera.height)
    )
    return camera.resized(width, height)
