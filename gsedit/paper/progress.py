"""The progress of an edit: everything that changes while it runs, which a checkpoint holds."""

from __future__ import annotations

from dataclasses import dataclass, field

from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.crops import ExactCrops, color_crops
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.update import Target, rates
from gsedit.paper.protocol import GroundTruth
from gsedit.paper.request import Request
from gsedit.paper.unedited import UneditedRenders
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.framing import bounds
from gsedit.select.region import Region
from gsedit.views.dataset import View
from rasterizer.blending.choose import is_compiled


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
    fitted: dict[int, tuple[Region | None, Target]] = field(default_factory=dict)
    """The targets as they were fitted last, with the region that limits their patches, if any."""


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
    crops: ExactCrops
    """Renders crops of the optimizer's scene, for fitting."""
    stopwatch: Stopwatch
    noise_seed: int
    """Seed of the noise that all batches of views share."""
    edited: EditedViews = field(default_factory=EditedViews)
    work: Work = field(default_factory=Work)


def start_progress(
    request: Request,
    unedited: UneditedRenders,
    stopwatch: Stopwatch,
    noise_seed: int,
) -> Progress:
    """The progress of an edit whose optimizer is at the unedited scene."""
    settings, scene = request.settings, request.scene
    optimizer = SceneOptimizer(
        scene,
        rates(settings.geometry, bounds(scene).radius),
        compiled=is_compiled(settings.execution),
        ranks=request.ranks,
    )
    return Progress(optimizer, _crops(request, unedited), stopwatch, noise_seed)


def _crops(request: Request, unedited: UneditedRenders) -> ExactCrops:
    """Crops from lists of what each pixel shows, or rendered where that is faster or needed."""
    settings, scene = request.settings, request.scene
    if settings.geometry == "full":
        return ExactCrops(settings.execution)
    is_coarse = request.coarse is not None
    return color_crops(scene, unedited.color_at, settings.execution, is_coarse=is_coarse)
