"""The records that every strategy shares: the request, the surveyed views, and what they became."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.editors.protocol import GroundTruth
from gsedit.errors import UsageError
from gsedit.files.pictures import fitted_size
from gsedit.fitting.crops import FEW, FEW_CELLS, ExactCrops, ListedCrops
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.fitting.random_crops import SHOWN
from gsedit.fitting.update import Target
from gsedit.regions.region import Region, composite, coverage, everything
from gsedit.reports.events import Event
from gsedit.reports.stopwatch import Stopwatch
from gsedit.session.reduce import Reduction, marked_rendering, reduce
from gsedit.session.request import Request
from gsedit.session.settings import EditSettings
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.plan import ViewPlan, plan_views, survey
from gsedit.views.subject import wholeness
from rasterizer.blending.choose import is_compiled
from rasterizer.camera import Camera
from rasterizer.numerics import Execution
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

LARGE_HELD_OUT = 4
"""Held-out views at which the edit of a large scene (see gsedit.views.coarse) is measured."""
UNSEEN = 1e-3
"""A Gaussian that shows in less than this many (survey) pixels of all edited views is not seen."""


@dataclass(frozen=True, eq=False)
class SurveyedViews:
    """The scene before the edit, as the views see it. `n` Gaussians, `v` views."""

    plan: ViewPlan
    weights: Float[Tensor, "v n"]
    """How much each view sees of each Gaussian, in pixels of a small picture."""
    renderings: Mapping[int, Rendering]
    """Of the planned views, and of the held-out ones unless the scene is large, by index
    (`Session.views`), with median depth."""
    reduction: Reduction
    """What is left out of the edit."""


@dataclass(eq=False)
class EditedViews:
    """The views edited so far; grows as the strategy asks for more."""

    targets: dict[int, View] = field(default_factory=dict)
    """By index, in the order in which they were edited."""
    pairs: list[tuple[str, str, float]] = field(default_factory=list)
    """(view, view, matched fraction) of every two views that were in a batch together."""
    answers: dict[int, Float[Tensor, "h w 3"]] = field(default_factory=dict)
    """What the editor made of these views, before the region limits it."""
    region: Region | None = None
    """Where the edit belongs; None until it is known (see gsedit.session.choose_region)."""
    voted: bool = False
    """Whether the region comes from the edited views, and changes with them."""
    ground_truth: GroundTruth | None = None
    """The map from unedited to truly edited pictures that the targets show, where it is known."""
    fitted: dict[int, tuple[Region | None, Target]] = field(default_factory=dict)
    """The targets as they were fitted last, with the region that limits their patches, if any."""


@dataclass(eq=False)
class Work:
    """How much of an edit is done."""

    actions: int = 0
    """Of the strategy's schedule."""
    steps: int = 0
    """Of the optimiser."""
    calls: int = 0
    """Views that the 2D editor was asked for; a view that it was asked for twice counts twice."""
    evaluations: int = 0
    """Of the editor's network: a view at one noise level under one condition is one."""


@dataclass(frozen=True, eq=False)
class Session:
    """An edit in progress. The optimiser holds the scene; the other records say what it follows."""

    request: Request
    surveyed: SurveyedViews
    renderings: dict[int, Rendering]
    """Of the unedited scene, by index: planned and held-out views, others once they are needed."""
    edited: EditedViews
    optimiser: SceneOptimiser
    stopwatch: Stopwatch
    noise_seed: int
    """Of the noise that all batches share."""
    work: Work = field(default_factory=Work)
    small_renderings: dict[int, Rendering] = field(default_factory=dict)
    """Of the unedited scene at the size at which views are edited, where it is not their own."""
    coverages: dict[int, tuple[Region, Float[Tensor, "h w"]]] = field(default_factory=dict)
    """What `coverage` returned, by index, and of which region."""

    @property
    def settings(self) -> EditSettings:
        """The request's."""
        return self.request.settings

    @property
    def views(self) -> tuple[View, ...]:
        """What indices are into: the views that may be edited, then those that are held out."""
        return (*self.request.views, *self.request.held_out)

    @property
    def held_out(self) -> tuple[int, ...]:
        """Indices of the held-out views."""
        return tuple(range(len(self.request.views), len(self.views)))

    @property
    def scene(self) -> Gaussians:
        """The request's scene as it is now, without gradients: of a large one, its cells."""
        return self.optimiser.scene.detach()

    @cached_property
    def crops(self) -> ExactCrops:
        """Draws crops of the scene as it is now, for fitting."""
        settings, scene = self.settings, self.request.scene
        is_coarse = self.request.coarse is not None
        moves = settings.geometry == "full" or not settings.leaves_out("geometry")
        few = len(scene) < (FEW_CELLS if is_coarse else FEW)
        if moves or (few and is_compiled(settings.execution)):
            return ExactCrops(settings.execution, depth=not settings.leaves_out("depth"))
        transparent = scene.logit_opacities.masked_fill(self.surveyed.reduction.left, -torch.inf)
        drawn = replace(scene, logit_opacities=transparent)
        return ListedCrops(drawn, self._color_before, settings.execution, is_coarse=is_coarse)

    def _color_before(self, camera: Camera) -> Float[Tensor, "h w 3"]:
        """Of the scene before the edit; rendered only where it is not known."""
        for i, view in enumerate(self.views):
            if view.camera is camera:
                return self.unedited_rendering(i).color
        return rendering_of(self.request.whole, camera, self.settings.execution).color

    @property
    def whole_scene(self) -> Gaussians:
        """A copy of the scene as it is now, with everything that is left out of the edit, and all
        Gaussians of a large one."""
        if (coarse := self.request.coarse) is not None:
            return coarse.transfer(self.scene)
        return self.surveyed.reduction.restored(self.scene).map(torch.clone)

    @property
    def seen(self) -> Bool[Tensor, " n"]:
        """The Gaussians of the region that the edited views see, or the planned ones before any is
        edited. No others move; without a plan, all of the region may.
        """
        return self.seen_from(self.edited.targets or self.surveyed.plan.views)

    def seen_from(self, views: Iterable[int]) -> Bool[Tensor, " n"]:
        """The Gaussians of the region that these of the views that may be edited see."""
        if not self.settings.leaves_out("gaussians"):
            return self.region.inside
        seen = self.surveyed.weights[list(views)].sum(0) > UNSEEN
        return seen & self.region.inside & ~self.surveyed.reduction.left

    @property
    def region(self) -> Region:
        """Where the edit belongs, as far as it is known: everywhere before it is."""
        return self.edited.region or everything(self.request.scene)

    def within_region(self, i: int, edited: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w 3"]:
        """The edited picture of view i where the region shows, the unedited render elsewhere."""
        if self.region.is_all:
            return edited
        unedited = self.unedited_picture(i)
        return composite(edited, unedited, self.coverage(i))

    def coverage(self, i: int) -> Float[Tensor, "h w"]:
        """The region's share of each pixel of the unedited scene at view i, in [0, 1]."""
        region = self.region
        known = self.coverages.get(i)
        if known is None or known[0] is not region:
            scene, camera = self.request.scene, self.views[i].camera
            known = region, coverage(region, scene, camera, self.settings.execution)
            self.coverages[i] = known
        return known[1]

    def shown(self, views: Iterable[int]) -> list[Bool[Tensor, "h w"]] | None:
        """Where the region shows in these views. None where it is everything, or shows nowhere, or
        nothing is to be left out: crops are then drawn from everywhere.
        """
        if self.region.is_all or not self.settings.leaves_out("crops"):
            return None
        shown = [self.coverage(i) > SHOWN for i in views]
        return shown if any(mask.any() for mask in shown) else None

    @torch.no_grad()
    def render(self, cameras: Iterable[Camera]) -> list[Float[Tensor, "h w 3"]]:
        """Pictures of the scene as it is now, in [0, 1]."""
        execution, unread = self.settings.execution, not self.settings.leaves_out("depth")
        scene = self.scene if self.request.coarse is None else self.whole_scene
        draw = partial(render, scene, depth=unread, median_depth=unread, execution=execution)
        return [draw(camera).color.clamp(0, 1) for camera in cameras]

    def preview(self, i: int, camera: Camera | None = None) -> Float[Tensor, "h w 3"]:
        """The scene as it is now at view i, in [0, 1], or at the `camera` at which it is edited.

        Of a large scene: the unedited picture, and what became of its cells.
        """
        camera = camera or self.views[i].camera
        if self.request.coarse is None:
            return self.render([camera])[0]
        is_own = camera is self.views[i].camera
        unedited = self.unedited_rendering(i) if is_own else self.edit_rendering(i)
        execution = self.settings.execution
        now, before = (
            rendering_of(scene, camera, execution).color
            for scene in (self.scene, self.request.scene)
        )
        return (unedited.color + now - before).clamp(0, 1)

    @property
    def measured(self) -> tuple[int, ...]:
        """The held-out views that are measured at: of a large scene a few, for a picture of all of
        its Gaussians takes seconds.
        """
        few = len(self.held_out) if self.request.coarse is None else LARGE_HELD_OUT
        return tuple(self.held_out[i] for i in evenly_spaced(len(self.held_out), few))

    def unedited_rendering(self, i: int) -> Rendering:
        """Of the scene before the edit, at view i."""
        if i not in self.renderings:
            camera = self.views[i].camera
            rendering = rendering_of(self.request.whole, camera, self.settings.execution)
            self.renderings[i] = rendering
        return self.renderings[i]

    def unedited_picture(self, i: int) -> Float[Tensor, "h w 3"]:
        """Of the scene before the edit, at view i, in [0, 1]."""
        return self.unedited_rendering(i).color.clamp(0, 1)

    def edit_camera(self, i: int) -> Camera:
        """View i's camera at the size at which it is edited, see `EditSettings.edit_size`."""
        return edit_camera(self.views[i].camera, self.settings)

    def edit_rendering(self, i: int) -> Rendering:
        """Of the scene before the edit, at the size at which view i is edited."""
        camera = self.edit_camera(i)
        if camera is self.views[i].camera:
            return self.unedited_rendering(i)
        if i not in self.small_renderings:
            rendering = rendering_of(self.request.whole, camera, self.settings.execution)
            self.small_renderings[i] = rendering
        return self.small_renderings[i]

    def unedited_image(self, i: int) -> Float[Tensor, "h w 3"]:
        """What the editor is shown as the unedited picture of view i, in [0, 1].

        Where the photo is masked, the render is shown: an edited picture has no hole.
        """
        rendered = self.unedited_rendering(i).color
        if self.settings.condition != "photo":
            return rendered.clamp(0, 1)
        view = self.views[i]
        picture = view.image.to(rendered)
        if view.mask is not None:
            picture = torch.where(view.mask[..., None], picture, rendered)
        return picture.clamp(0, 1)


def survey_views(
    request: Request, stopwatch: Stopwatch, planned: ViewPlan | None = None
) -> Generator[Event, None, tuple[Request, SurveyedViews]]:
    """Plan which views to edit (unless that is `planned`), leave out what that does not need, and
    render these views and the held-out ones, before the edit. The request is what is left of it.

    Raises UsageError where no view sees the scene.
    """
    settings, views = request.settings, request.views
    yield Event("survey", stopwatch.seconds, note=f"{len(views)} views")
    with stopwatch.stage("survey"):
        cameras = [view.camera for view in views]
        weights = survey(request.scene, cameras, settings.execution)
        if not weights.any():
            raise UsageError(
                "no camera sees any of the scene: are both in the same frame? "
                "Leave out --data to have cameras placed around the scene"
            )
        plan = planned or plan_views(
            weights,
            settings.views_per_round,
            settings.rounds,
            settings.coverage if settings.leaves_out("views") else 1.0,
            overlap=settings.overlap,
            whole=wholeness(request.scene.means, cameras, weights),
        )
        request, reduction = reduce(request, weights, plan)
        every = (*request.views, *request.held_out)
        left = reduction.left if request.coarse is None else request.coarse.expand(reduction.left)
        draw = partial(marked_rendering, request.whole, left=left)
        held_out = range(len(views), len(every)) if request.coarse is None else ()
        renderings = {
            i: draw(every[i].camera, execution=settings.execution) for i in (*plan.views, *held_out)
        }
    note = f"{len(plan.views)} cover {plan.coverage[-1]:.0%} of what all views see"
    note += _carrying(request.views[0].camera, settings)
    if request.coarse is not None:
        note += f"; {len(request.whole):,} Gaussians edited as {len(request.scene):,} cells"
    yield Event("survey", stopwatch.seconds, len(views), len(views), note=note)
    return request, SurveyedViews(plan, weights, renderings, reduction)


def edit_camera(camera: Camera, settings: EditSettings) -> Camera:
    """The camera at the size at which its view is edited; itself where that is its own."""
    width, height = fitted_size(camera.width, camera.height, settings.edit_size)
    if (width, height) == (camera.width, camera.height):
        return camera
    return camera.resized(width, height)


def _carrying(camera: Camera, settings: EditSettings) -> str:
    """At which size views are edited, for a person; nothing where it is their own."""
    small = edit_camera(camera, settings)
    if small is camera:
        return ""
    return (
        f"; edited at {small.width}x{small.height} pixels, the change carried to "
        f"{camera.width}x{camera.height}"
    )


@torch.no_grad()
def rendering_of(scene: Gaussians, camera: Camera, execution: Execution) -> Rendering:
    """A render without gradients, with median depth."""
    return render(scene, camera, median_depth=True, execution=execution)
