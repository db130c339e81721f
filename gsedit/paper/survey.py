"""The survey of an edit: which views are edited, and what of the scene they show.

`n` Gaussians, `v` views, `k` coefficients a channel, `d` degrees from 1 on.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from math import isqrt, pi, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.solve import MOST_COEFFICIENTS
from gsedit.errors import UsageError
from gsedit.paper.request import Request
from gsedit.paper.unedited import edit_camera
from gsedit.paper.view_plan import ViewPlan, plan_views, random_plan, survey, wholeness
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch

INVISIBLE_COLOR = 1 / 510
"""Color difference in [0, 1] that no picture shows: half a step of an 8-bit picture."""


def survey_views(
    request: Request, stopwatch: Stopwatch, plan: ViewPlan | None = None
) -> Generator[Event, None, tuple[Request, ViewPlan, Float[Tensor, "v n"]]]:
    """Plan which views to edit, unless there is a `plan`.

    Returns the request with the bands that are fitted, the plan, and how much each view sees of
    each Gaussian, in pixels of a small picture. Raises UsageError where no view sees the scene.
    """
    views = request.views
    yield Event("survey", stopwatch.seconds, note=f"{len(views)} views")
    with stopwatch.stage("survey"):
        cameras = [view.camera for view in views]
        weights = survey(request.scene, cameras)
        plan = plan or _plan(request, weights)
        scene = request.scene
        least = MOST_COEFFICIENTS if request.solves else 1
        fitted = scene.sh[:, : max(least, visible_coefficients(scene.sh))]
        request = replace(request, scene=replace(scene, sh=fitted))
    yield Event("survey", stopwatch.seconds, len(views), len(views), note=_note(request, plan))
    return request, plan, weights


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
        return random_plan(weights, each, settings.most_batches, seed)
    return plan_views(
        weights,
        settings.views_per_batch,
        settings.most_batches,
        settings.coverage if settings.skips("views") else 1.0,
        overlap=settings.overlap,
        whole=wholeness(request.scene.means, cameras, weights),
    )


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


def band_colors(sh: Float[Tensor, "n k 3"]) -> Float[Tensor, "n d"]:
    """The most that each degree adds to a color, over all directions and channels.

    By Cauchy-Schwarz: the squares of a degree's 2 d + 1 harmonics add up to (2 d + 1) / (4 pi) in
    every direction (the addition theorem).
    """
    degrees = range(1, isqrt(sh.shape[1]))
    columns = [
        sh[:, d * d : (d + 1) ** 2].norm(dim=1).amax(-1) * sqrt((2 * d + 1) / (4 * pi))
        for d in degrees
    ]
    return torch.stack(columns, -1) if columns else sh.new_zeros(len(sh), 0)


def visible_coefficients(sh: Float[Tensor, "n k 3"]) -> int:
    """Coefficients a channel that an edit renders and fits.

    The highest degrees are not among them where they together add at most `INVISIBLE_COLOR` to
    the color of every Gaussian.
    """
    tails = band_colors(sh).flip(-1).cumsum(-1).flip(-1)
    colors = tails.amax(0).tolist() if len(tails) else [0.0] * tails.shape[1]
    degree = next((i for i, color in enumerate(colors) if color <= INVISIBLE_COLOR), len(colors))
    return (degree + 1) ** 2
