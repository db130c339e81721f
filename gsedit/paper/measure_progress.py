"""The error of the scene while an edit runs, at a few views."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.formulas import psnr
from gsedit.paper.session import Session, preview
from gsedit.run.events import Event
from gsedit.views.dataset import evenly_spaced

MAX_PROGRESS_VIEWS = 3
"""Most views that are measured while the work goes on, and by the perceptual distance at the end;
the other metrics are measured at all."""


def error_event(
    stage: str,
    seconds: float,
    decibels: float | None,
    truths: int,
    step: int = 0,
    steps: int = 0,
    loss: float | None = None,
) -> Event:
    """A mean PSNR, if there is one, as an event: to the true edit of so many held-out views, or of
    none, to the targets, which tells how far the scene follows them and not how good they are."""
    if decibels is None:
        return Event(stage, seconds, step, steps, loss)
    known = f"ground truth at {truths} held-out cameras"
    against = known if truths else "targets it is fitted to (residual)"
    note = f"{decibels:.2f} dB to the {against}"
    return Event(stage, seconds, step, steps, loss, rmse_from_psnr(decibels), note)


def measure_progress(session: Session, step: int, steps: int, loss: float | None) -> Event:
    """The error of the scene as it is now, at up to three evenly spaced views.

    Against the ground truth at held-out cameras where it is known, otherwise against the targets.
    """
    truths = true_edits(session, _few(session.request.evaluation_views))
    targets = session.progress.edited.targets
    expected = truths or {i: targets[i].image for i in _few(tuple(targets))}
    values = [psnr(preview(session, i), image) for i, image in expected.items()]
    decibels = sum(values) / len(values) if values else None
    seconds = session.progress.stopwatch.seconds
    return error_event("update", seconds, decibels, len(truths), step, steps, loss)


def true_edits(session: Session, views: Sequence[int]) -> dict[int, Float[Tensor, "h w 3"]]:
    """The true edit of these views within the region, by index; nothing where it is unknown."""
    truth = session.progress.edited.ground_truth
    if truth is None:
        return {}
    unedited = {i: session.unedited.picture(i) for i in views}
    return {i: session.within_region(i, truth(image[None])[0]) for i, image in unedited.items()}


def _few(indices: Sequence[int]) -> list[int]:
    """At most MAX_PROGRESS_VIEWS of the indices, evenly spaced."""
    return [indices[i] for i in evenly_spaced(len(indices), MAX_PROGRESS_VIEWS)] if indices else []
