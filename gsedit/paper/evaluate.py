"""Evaluate the result of an edit, and gather the pictures that show it."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.measures.against import TARGETS_ARE
from gsedit.measures.agreement import Pictures, UneditedViews, spread
from gsedit.measures.evaluation import evaluate
from gsedit.measures.evaluation_input import EvaluationInput
from gsedit.paper.edit_views import MEASURE, match_views, sample_views
from gsedit.paper.evidence import SHEET_HELD_OUT_VIEWS, EditMetrics, Evidence, HeldOutViews
from gsedit.paper.measure_progress import MAX_PROGRESS_VIEWS, error_event, true_edits
from gsedit.paper.request import name_of
from gsedit.paper.session import Session
from gsedit.run.events import Event
from gsedit.scene.outcome import Outcome
from gsedit.scene.picture import render_picture
from gsedit.select.region import Region
from gsedit.views.dataset import View
from gsedit.views.view_list_files import Role, ViewList
from gsedit.views.viewpoints import Viewpoint


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing(Outcome):
    """A scene after a 2D editor drew its views, with all bands and Gaussians."""

    region: Region
    """The Gaussians that could change."""
    evidence: Evidence


def evaluate_edit(session: Session) -> Generator[Event, None, Drawing]:
    """Render the edited scene, ask the editor for held-out views, and measure.

    Yields the editor's steps, and last what the progress was measured by, over all views.
    """
    request, views = session.request, session.request.every_view
    shown = tuple(session.progress.edited.targets or session.plan.views)
    asked = request.settings.held_out_edits
    held_out = spread(request.held_out_indices, max(SHEET_HELD_OUT_VIEWS, asked))
    asked_views = held_out[:asked] if session.progress.edited.answers else ()
    answers = yield from _edit_held_out(session, asked_views)
    alone = yield from _edit_alone(session, asked_views)
    given = replace(_evaluation_input(session, shown, held_out, answers), edits_alone=alone)
    metrics = EditMetrics(evaluate(given), tuple(session.progress.edited.pairs))
    truths = len(given.ground_truth)
    final = metrics.psnr_to_ground_truth if truths else metrics.psnr_to_targets
    yield error_event("measure", session.progress.stopwatch.seconds, final, truths)
    originals = {i: session.unedited.picture(i) for i in (*shown, *held_out)}
    evidence = Evidence(
        metrics=metrics,
        timings={},
        settings=request.settings,
        held_out=HeldOutViews(
            _with_pictures(views, originals, held_out),
            _with_pictures(views, answers, answers),
            _with_pictures(views, given.finals, held_out),
            _with_pictures(views, alone, alone),
        ),
        originals=_with_pictures(views, originals, shown),
        targets=tuple(session.progress.edited.targets.values()),
        finals=_with_pictures(views, given.finals, shown),
        strategy=request.strategy,
        strategy_name=name_of(request.strategy),
        view_plan=session.plan,
        work=session.progress.work,
    )
    scene, region = given.scene, given.region or session.region
    rows = torch.arange(len(scene))
    return Drawing(scene, rows, region.inside, region=region, evidence=evidence)


def _evaluation_input(
    session: Session, shown: tuple[int, ...], held_out: tuple[int, ...], answers: Pictures
) -> EvaluationInput:
    """The edited scene rendered at edited and held-out views, and all that it is compared with."""
    request, views = session.request, session.request.every_view
    measured = tuple(dict.fromkeys((*request.evaluation_views, *held_out)))
    scene, region = session.whole_scene(), session.region
    if request.coarse is not None:
        region = replace(region, inside=request.coarse.expand(region.inside))
    finals = {i: render_picture(scene, views[i].camera) for i in (*shown, *measured)}
    targets = {i: view.image for i, view in session.progress.edited.targets.items()}
    return EvaluationInput(
        scene,
        _view_list(views, shown, measured),
        {**targets, **answers},
        targets_are=TARGETS_ARE,
        unedited=request.whole,
        region=region,
        max_perceptual_views=MAX_PROGRESS_VIEWS,
        ground_truth=true_edits(session, request.evaluation_views),
        finals=finals,
        renderings={i: session.unedited.rendering(i) for i in finals},
    )


def _view_list(views: tuple[View, ...], edited: Iterable[int], held_out: Iterable[int]) -> ViewList:
    """The views with their roles; those that are neither edited nor measured are neighbors."""
    roles: dict[int, Role] = {i: "held_out" for i in held_out}
    roles.update((i, "edited") for i in edited)
    viewpoints = tuple(Viewpoint(view.name, view.camera) for view in views)
    return ViewList(viewpoints, tuple(roles.get(i, "other") for i in range(len(views))))


def _with_pictures(
    views: tuple[View, ...], pictures: Pictures, indices: Iterable[int]
) -> tuple[View, ...]:
    """The views with these indices, showing these pictures."""
    return tuple(replace(views[i], image=pictures[i]) for i in indices)


def _edit_held_out(
    session: Session, views: tuple[int, ...]
) -> Generator[Event, None, Mapping[int, Float[Tensor, "h w 3"]]]:
    """Ask the editor for these held-out views as it was asked for the targets.

    They are tied to targets by anchors and the noise that all batches share. Nothing is asked where
    that has no meaning: the editor is no diffusion model, so it has no noise to share. Sampling
    starts from the unedited scene: the answers must not depend on the edited scene, which is
    compared with them.
    """
    answers, editor = session.progress.edited.answers, session.request.editor
    if not views or editor.capabilities.denoiser is None:
        return {}
    cameras = [view.camera for view in session.request.every_view]
    unedited = UneditedViews(cameras, session.unedited.rendering)
    near = zip(*(unedited.nearest(view, answers) for view in views))  # in turn, a view at a time
    nearest = tuple(dict.fromkeys(chain.from_iterable(near)))
    anchors = nearest[: session.request.settings.anchors]
    members = (*views, *anchors)
    images = yield from sample_views(
        session,
        members,
        anchors,
        match_views(session, members),
        session.request.settings.sampler,
        start={i: session.unedited.picture(i) for i in views},
        stage=MEASURE,
    )
    return {i: session.within_region(i, image) for i, image in zip(views, images)}


def _edit_alone(
    session: Session, views: tuple[int, ...]
) -> Generator[Event, None, Mapping[int, Float[Tensor, "h w 3"]]]:
    """Ask the editor for each of these views on its own, in a batch of its own: no anchor, nothing
    shared, not harmonised. What the targets agree on does not help these pictures."""
    alone, sampler = {}, session.request.settings.sampler
    editor = session.request.editor  # nothing that it takes from the planned views
    for i in views:
        start = {i: session.unedited.picture(i)}
        (image,) = yield from sample_views(session, (i,), (), None, sampler, start, MEASURE, editor)
        alone[i] = session.within_region(i, image)
    return alone
