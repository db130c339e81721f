"""Fit the scene to the views edited so far, in steps on random crops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import repeat

from gsedit.errors import InputError
from gsedit.fitting.crops import ListedCrops
from gsedit.fitting.random_crops import crops_needed
from gsedit.fitting.update import Target, update_steps
from gsedit.paper.measure_progress import measure_progress
from gsedit.paper.session import Session, region_masks, seen_gaussians
from gsedit.paper.unedited import render_with_depth
from gsedit.runs.events import Event

MEASURE_EVERY_STEPS = 50
"""Optimizer steps between two measurements of the scene: each renders three views."""
REPORT_EVERY_STEPS = 10
"""Optimizer steps between two events with the loss."""


def fit_targets(
    session: Session, span: range, round_steps: int, *, done: int = 0, total: int
) -> Iterator[Event]:
    """Fit the targets by the steps `span` of a round of `round_steps`.

    `done` of `total` steps of the whole edit came before the round.
    """
    request, progress = session.request, session.progress
    stopwatch, update = progress.stopwatch, request.settings.update
    if not progress.edited.targets:
        raise InputError("the checkpoint has no edited views to fit: remove it, and start again")
    targets = _targets(session)
    share = sum(target.share for target in targets) / len(targets)
    update = replace(update, patches=crops_needed(update.patches, share))
    with stopwatch.stage("update"):
        if progress.crops.is_coarse and total - done - round_steps // 2 in span:
            _calibrate_crops(session, targets)
        losses = update_steps(
            progress.optimizer,
            targets,
            seen_gaussians(session),
            span,
            round_steps,
            update,
            request.features,
            request.generator,
            progress.crops,
        )
        for step, loss in enumerate(losses, start=done + span.start + 1):
            progress.work.steps += 1
            if step % MEASURE_EVERY_STEPS == 0:
                measured = measure_progress(session)
                yield measured.event("update", stopwatch.seconds, step, total, loss)
            elif step % REPORT_EVERY_STEPS == 0:
                yield Event("update", stopwatch.seconds, step, total, loss)


def _targets(session: Session) -> list[Target]:
    """The edited views as they are fitted; only those that changed since the last time are new."""
    edited, patch = session.progress.edited, session.request.settings.update.patch
    masks = region_masks(session, edited.targets)
    region = None if masks is None else session.region
    for i, view, mask in zip(edited.targets, edited.targets.values(), masks or repeat(None)):
        of, known = edited.fitted.get(i, (None, None))
        if known is None or known.view is not view or of is not region:
            edited.fitted[i] = region, Target(view, mask, patch)
    return [edited.fitted[i][1] for i in edited.targets]


def _calibrate_crops(session: Session, targets: list[Target]) -> None:
    """Render the targets' views of a large scene, and correct the crops of its groups by them.

    Groups look nearly like the scene, and the nearer the less remains to be done: here half of the
    last round.
    """
    progress, scene = session.progress, session.whole_scene()
    if isinstance(progress.crops, ListedCrops):
        execution = session.request.settings.execution
        for target in targets:
            for each in dict.fromkeys((target.small, target.view)):
                picture = render_with_depth(scene, each.camera, execution).color
                progress.crops.meet(each, picture, progress.optimizer)
