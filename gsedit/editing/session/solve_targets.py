"""Bring the scene to the colors that fit the views edited so far best."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from gsedit.editing.session.measure_progress import measure_progress
from gsedit.editing.session.session import Session, preview
from gsedit.errors import InputError
from gsedit.fitting.solve import solve_colors
from gsedit.runs.events import Event


def solve_targets(session: Session, step: int, total: int) -> Iterator[Event]:
    """Solve for the colors of the region that fit all targets; its events are of `step`.

    Opacities and geometry stay. Of a large scene the groups move. Raises InputError where a
    checkpoint left no targets.
    """
    request, progress = session.request, session.progress
    optimizer, inside, targets = progress.optimizer, session.region.inside, progress.edited.targets
    if not targets:
        raise InputError("the checkpoint has no edited views to fit: remove it, and start again")
    with progress.stopwatch.stage("update"):
        optimizer.raise_negative_colors(inside)
        start, views = optimizer.scene.detach(), list(targets.values())
        pictures = None if request.coarse is None else [preview(session, i) for i in targets]
        execution = request.settings.execution
        solved = list(solve_colors(start, views, inside, pictures=pictures, execution=execution))
        progress.work.steps += len(solved)
        if solved:
            every = torch.ones(len(start), dtype=torch.bool)
            progress.work.followed = solved[-1].followed
            progress.work.map_error = solved[-1].map_error
            optimizer.replace(solved[-1].scene, torch.arange(len(start)), fresh=every)
        measured = measure_progress(session)
        loss = solved[-1].mse if solved else None
        yield measured.event("update", progress.stopwatch.seconds, step, total, loss)
