"""Fit the scene to the views edited so far."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from gsedit.fitting.update import update_steps
from gsedit.reports.events import Checkpoint, Event
from gsedit.session.quality import measure
from gsedit.session.session import Session

MEASURE_EVERY = 50
REPORT_EVERY = 10


def fit_targets(session: Session, steps: int, *, done: int = 0, total: int) -> Iterator[Event]:
    """`steps` of fitting; `done` of `total` steps of the whole edit came before them."""
    stopwatch = session.stopwatch
    with stopwatch.stage("update"):
        losses = update_steps(
            session.optimiser,
            tuple(session.edited.targets.values()),
            session.seen,
            steps,
            session.settings.update,
            session.request.features,
            session.request.generator,
            session.settings.execution,
        )
        for step, loss in enumerate(losses, start=done + 1):
            if step % MEASURE_EVERY == 0:
                yield measure(session).event("update", stopwatch.seconds, step, total, loss)
            elif step % REPORT_EVERY == 0:
                yield Event("update", stopwatch.seconds, step, total, loss)


def checkpoint(session: Session, step: int) -> Checkpoint:
    """A copy of the scene as it is now."""
    return Checkpoint(session.scene.map(torch.clone), step, session.stopwatch.seconds)
