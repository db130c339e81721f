"""The session of an edit: the request, the surveyed views, the unedited renders, and the progress.

Actions change the progress; everything else is given, or can be rendered again. `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.update import MIN_SHOWN_SHARE, Target, rates
from gsedit.paper.editors.protocol import GroundTruth, StylePainter
from gsedit.paper.request import Request
from gsedit.paper.view_plan import ViewPlan
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.framing import bounds
from gsedit.select.region import Region, coverage, everything
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.image_ops import downscale
from rasterizer.blending.choose import is_compiled
from rasterizer.camera import Camera
from rasterizer.render import Rendering, render, render_picture
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
            self._renderings[key] = render_with_depth(self.request.scene, camera)
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
        if not isinstance(self.request.editor, StylePainter):
            return picture
        return picture + (1 - rendering.alpha.clamp(0, 1))[..., None] * self._mean_color

    @cached_property
    def _mean_color(self) -> Float[Tensor, "3"]:
        """The mean color of what the first view shows; black where it shows nothing."""
        shown = self.rendering(0)
        return shown.color.clamp(0, 1).sum((0, 1)) / shown.alpha.sum().clamp_min(1e-6)

    @cached_property
    def tones(self) -> tuple[float, float]:
        """Luminance that nearly all that a few views show is between."""
        shown = [self.rendering(i) for i in evenly_spaced(len(self.request.every_view), 4)]
        seen = torch.cat([each.color.clamp(0, 1)[each.alpha > 0.5] for each in shown])
        low, high = (
            np.quantile(seen.double().numpy() @ LUMINANCE, (0.02, 0.97)) if len(seen) else (0, 1)
        )
        return float(low), float(high)

    def coverage(self, region: Region, i: int) -> Float[Tensor, "h w"]:
        """The region's share of each pixel of view i, in [0, 1]; kept for the last region."""
        known = self._coverages.get(i)
        if known is None or known[0] is not region:
            request, camera = self.request, self.request.every_view[i].camera
            share = coverage(region, request.scene, camera)
            known = self._coverages[i] = (region, share)
        return known[1]


@torch.no_grad()
def render_with_depth(scene: Gaussians, camera: Camera) -> Rendering:
    """A render without gradients, with median depth."""
    return render(scene, camera, median_depth=True)


def edit_camera(camera: Camera, edit_size: int | None) -> Camera:
    """The camera at the size at which its view is edited; itself where that is its own size."""
    if edit_size is None or edit_size == camera.longest:
        return camera
    sides = (round(side * edit_size / camera.longest) for side in (camera.width, camera.height))
    return camera.resized(*(max(1, side) for side in sides))


@dataclass(eq=False)
class EditedViews:
    """The views edited so far; grows as the strategy asks for more."""

    targets: dict[int, View] = field(default_factory=dict)
    """Edited views that the scene is fitted to, by index, in the order of their editing."""
    pairs: list[tuple[str, str, float]] = field(default_factory=list)
    """(view, view, matched fraction) of every two views that were in a batch together."""
    answers: dict[int, Float[Tensor, "h w 3"]] = field(default_factory=dict)
    """Pictures that the editor made of these views, before the region limits them."""
    region: Region | None = None
    """The region that the edit may change; None until it is known."""
    voted: bool = False
    """Whether the region comes from the edited views, and changes with them."""
    ground_truth: GroundTruth | None = None
    """The map from unedited to truly edited pictures that the targets show, where it is known."""
    fitted: dict[int, tuple[tuple[View, Region | None], Target]] = field(default_factory=dict)
    """The targets as they were fitted last, with the edited views and the region, if any, that they
    are of."""


@dataclass(eq=False)
class Work:
    """Counts of the work that an edit has done."""

    actions: int = 0
    """Actions of the strategy's schedule."""
    steps: int = 0
    """Steps of the optimizer."""
    calls: int = 0
    """Views that the 2D editor was asked for; a view that it was asked for twice counts twice."""
    evaluations: int = 0
    """Evaluations of the editor's network: a view at one noise level under one condition is one."""
    followed: int = 0
    """Gaussians that no edited view shows, and that followed the map of colors of the others."""
    map_error: float = 0.0
    """Root mean square of what the map leaves of the others' changes, in [0, 1]."""


@dataclass(frozen=True, eq=False)
class Progress:
    """The fitted scene, the edited views, and the work so far."""

    optimizer: SceneOptimizer
    """The optimizer, which holds the scene."""
    stopwatch: Stopwatch
    noise_seed: int
    """Seed of the noise that all batches of views share."""
    edited: EditedViews = field(default_factory=EditedViews)
    work: Work = field(default_factory=Work)


def start_progress(request: Request, stopwatch: Stopwatch, noise_seed: int) -> Progress:
    """The progress of an edit whose optimizer is at the unedited scene."""
    settings, scene = request.settings, request.scene
    optimizer = SceneOptimizer(
        scene,
        rates(settings.geometry, bounds(scene).radius),
        compiled=is_compiled(settings.execution),
    )
    return Progress(optimizer, stopwatch, noise_seed)


@dataclass(frozen=True, eq=False)
class Session:
    """An edit in progress."""

    request: Request
    plan: ViewPlan
    """The views that are edited."""
    weights: Float[Tensor, "v n"]
    """How much each view sees of each Gaussian, in pixels of a small picture."""
    unedited: UneditedRenders
    progress: Progress

    @property
    def scene(self) -> Gaussians:
        """The fitted scene as it is now, without gradients."""
        return self.progress.optimizer.scene.detach()

    @property
    def region(self) -> Region:
        """The region that the edit may change: everything, before it is known."""
        return self.progress.edited.region or everything(self.request.scene)

    def within_region(self, i: int, edited: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w 3"]:
        """The edited picture of view i where the region shows, the unedited one elsewhere. What is
        drawn where nothing is, strokes around an object, is left out."""
        region, unedited = self.region, self.unedited
        if region.is_all and isinstance(self.request.editor, StylePainter):
            return edited * unedited.rendering(i).alpha.clamp(0, 1)[..., None].to(edited)
        if region.is_all:
            return edited
        covered = unedited.coverage(region, i)[..., None].to(edited)
        return torch.lerp(unedited.picture(i), edited, covered)

    def target(self, i: int, edited: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w 3"]:
        """Target of the fit by a picture that the editor made of view i: of an edited
        photo without what the groups of a large scene lose, which is no edit."""
        request = self.request
        if request.whole is not None and request.settings.condition == "photo":
            whole = render_picture(request.whole, request.every_view[i].camera)
            edited = (edited + (self.unedited.picture(i) - whole).to(edited)).clamp(0, 1)
        return self.within_region(i, edited)


@torch.no_grad()
def preview(session: Session, i: int, camera: Camera | None = None) -> Float[Tensor, "h w 3"]:
    """The scene as it is now at view i, in [0, 1], or at the `camera` at which it is edited."""
    own = session.request.every_view[i].camera
    camera = camera or own
    if session.progress.work.steps:
        return render_picture(session.scene, camera)
    unedited = session.unedited
    before = unedited.rendering(i) if camera is own else unedited.edit_rendering(i)
    return before.color.clamp(0, 1)


def seen_gaussians(session: Session, views: Iterable[int] | None = None) -> Bool[Tensor, " n"]:
    """The Gaussians of the region that these views see; no others move.

    Without `views`: the edited ones, or the planned ones before any is edited.
    """
    rows = list(session.progress.edited.targets or session.plan.views) if views is None else views
    seen = session.weights[list(rows)].sum(0) > 1e-3  # pixels of the survey
    return seen & session.region.inside


def region_masks(session: Session, views: Iterable[int]) -> list[Bool[Tensor, "h w"]] | None:
    """The pixels of these views in which the region shows, for crops to be drawn from there.

    None where crops are drawn from everywhere: the region is everything, or shows nowhere.
    """
    region = session.region
    if region.is_all:
        return None
    masks = [session.unedited.coverage(region, i) > MIN_SHOWN_SHARE for i in views]
    return masks if any(mask.any() for mask in masks) else None
