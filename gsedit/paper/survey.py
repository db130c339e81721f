"""The survey of an edit: which views are edited, and what of the scene they show.

`n` Gaussians, `v` views.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.fitting.solve import MOST_COEFFICIENTS
from gsedit.paper.request import Request
from gsedit.paper.skip.invisible import faint_gaussians, visible_coefficients
from gsedit.paper.strategy import uses_all_views
from gsedit.paper.unedited import edit_camera
from gsedit.paper.view_plan import ViewPlan, plan_views, random_plan, survey, wholeness
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

MIN_WEIGHT = 1e-9
"""Floor of a view's total weight, survey pixels, where it is divided by."""


@dataclass(frozen=True, eq=False)
class SurveyedViews:
    """The plan of views, and the unedited scene as the views see it."""

    plan: ViewPlan
    weights: Float[Tensor, "v n"]
    """How much each view sees of each Gaussian, in pixels of a small picture."""
    renderings: Mapping[int, Rendering]
    """Renders of the planned views, and of the held-out ones unless the scene is large, by index,
    with median depth and where the `faint` Gaussians show."""
    faint: Bool[Tensor, " n"]
    """Gaussians that the update does not move though they are in the region: pictures hardly show
    them."""
    scene: Gaussians
    """The scene with all bands of spherical harmonics; the request's has those that are fitted."""


def survey_views(
    request: Request, stopwatch: Stopwatch, plan: ViewPlan | None = None
) -> Generator[Event, None, tuple[Request, SurveyedViews]]:
    """Plan which views to edit (unless there is a `plan`), and render them before the edit.

    Returns the request with the bands that are fitted, and what was surveyed. Raises UsageError
    where no view sees the scene.
    """
    settings, views = request.settings, request.views
    yield Event("survey", stopwatch.seconds, note=f"{len(views)} views")
    with stopwatch.stage("survey"):
        cameras = [view.camera for view in views]
        weights = survey(request.scene, cameras, settings.execution)
        plan = plan or _plan(request, weights)
        used = weights if uses_all_views(request.strategy) else weights[list(plan.views)]
        faint = torch.zeros(len(request.scene), dtype=torch.bool)
        if settings.skips("gaussians") and not request.solves:
            faint = faint_gaussians(used / used.sum(1, keepdim=True).clamp_min(MIN_WEIGHT))
        scene = request.scene
        least = MOST_COEFFICIENTS if request.solves else 1
        fitted = scene.sh[:, : max(least, visible_coefficients(scene.sh, ~faint))]
        request = replace(request, scene=replace(scene, sh=fitted))
        renderings = _renderings(request, plan, faint)
    yield Event("survey", stopwatch.seconds, len(views), len(views), note=_note(request, plan))
    return request, SurveyedViews(plan, weights, renderings, faint, scene)


def _plan(request: Request, weights: Float[Tensor, "v n"]) -> ViewPlan:
    """The plan of views. Raises UsageError where no view sees the scene."""
    if not weights.any():
        raise UsageError(
            "no camera sees any of the scene: given cameras may not be in the same frame "
            "(without them, some are placed around the scene), or no opacity reaches 1/255"
        )
    settings, cameras = request.settings, [view.camera for view in request.views]
    if settings.view_plan == "random":
        seed, each = request.generator.initial_seed(), settings.views_per_batch
        return random_plan(weights, each, settings.batches, seed)
    return plan_views(
        weights,
        settings.views_per_batch,
        settings.batches,
        settings.coverage if settings.skips("views") else 1.0,
        overlap=settings.overlap,
        whole=wholeness(request.scene.means, cameras, weights),
    )


@torch.no_grad()
def _renderings(
    request: Request, plan: ViewPlan, faint: Bool[Tensor, " n"]
) -> dict[int, Rendering]:
    """The unedited scene at the planned and the held-out views; not the latter of a large scene."""
    held_out = request.held_out_indices if request.coarse is None else ()
    marked = faint if request.coarse is None else request.coarse.expand(faint)
    return {
        i: render(
            request.whole,
            request.every_view[i].camera,
            median_depth=True,
            marked=marked if marked.any() else None,
            execution=request.settings.execution,
        )
        for i in (*plan.views, *held_out)
    }


def _note(request: Request, plan: ViewPlan) -> str:
    """Views, the size at which they are edited and the number of Gaussians, for a person."""
    note = f"{len(plan.views)} cover {plan.coverage[-1]:.0%} of what all views see"
    camera = request.views[0].camera
    small = edit_camera(camera, request.settings.edit_size)
    if small is not camera:
        note += (
            f"; edited at {small.width}x{small.height} pixels, the change carried to "
            f"{camera.width}x{camera.height}"
        )
    if request.coarse is not None:
        note += f"; {len(request.whole):,} Gaussians edited as {len(request.scene):,} groups"
    return note
