"""Fit the scene to the views edited so far."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import repeat

from gsedit.fitting.crops import ListedCrops
from gsedit.fitting.random_crops import crops_needed
from gsedit.fitting.update import Target, update_steps
from gsedit.reports.events import Event
from gsedit.session.quality import measure
from gsedit.session.session import Session, rendering_of

MEASURE_EVERY = 50
REPORT_EVERY = 10


def fit_targets(
    session: Session, span: range, round_steps: int, *, done: int = 0, total: int
) -> Iterator[Event]:
    """The steps `span` of a round of `round_steps` of fitting.

    `done` of `total` steps of the whole edit came before the round.
    """
    stopwatch, settings = session.stopwatch, session.settings
    targets, update = _targets(session), settings.update
    share = sum(target.share for target in targets) / len(targets)
    update = replace(update, patches=crops_needed(update.patches, share))
    with stopwatch.stage("update"):
        if session.crops.is_coarse and total - done - round_steps // 2 in span:
            _meet_targets(session)
        losses = update_steps(
            session.optimiser,
            targets,
            session.seen,
            span,
            round_steps,
            update,
            session.request.features,
            session.request.generator,
            session.crops,
            session.request.ranks,
        )
        for step, loss in enumerate(losses, start=done + span.start + 1):
            session.work.steps += 1
            if step % MEASURE_EVERY == 0:
                yield measure(session).event("update", stopwatch.seconds, step, total, loss)
            elif step % REPORT_EVERY == 0:
                yield Event("update", stopwatch.seconds, step, total, loss)


def _targets(session: Session) -> list[Target]:
    """The edited views as they are fitted: those that changed since the last time are made anew."""
    edited = session.edited
    shown = session.shown(edited.targets)
    region = None if shown is None else session.region
    for i, view, mask in zip(edited.targets, edited.targets.values(), shown or repeat(None)):
        of, known = edited.fitted.get(i, (None, None))
        if known is None or known.view is not view or of is not region:
            edited.fitted[i] = region, Target(view, mask, session.settings.update.patch)
    return [edited.fitted[i][1] for i in edited.targets]


def _meet_targets(session: Session) -> None:
    """Draw the targets' views of a large scene anew: what its cells look like is near that, and
    nearer the less remains to be done, here half of the last round.
    """
    crops, scene = session.crops, session.whole_scene
    if isinstance(crops, ListedCrops):
        for target in _targets(session):
            for each in dict.fromkeys((target.small, target.view)):
                picture = rendering_of(scene, each.camera, session.settings.execution).color
                crops.meet(each, picture, session.optimiser)
