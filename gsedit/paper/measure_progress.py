"""The error of the scene while an edit runs, at a few views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import evenly_spaced
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.metrics import psnr
from gsedit.paper.session import Session, preview
from gsedit.runs.events import Event

MAX_PROGRESS_VIEWS = 3
"""Most views that are measured while the work goes on, and by the perceptual distance at the end;
the other metrics are measured at all."""


@dataclass(frozen=True)
class Measurement:
    """Mean PSNR of the scene's renders to other pictures."""

    decibels: float | None
    """PSNR in dB; None where there is nothing to compare with."""
    against: str
    """The pictures that the renders were compared with, for a person."""

    def event(
        self, stage: str, seconds: float, step: int = 0, steps: int = 0, loss: float | None = None
    ) -> Event:
        """The measurement as an event of that stage."""
        if self.decibels is None:
            return Event(stage, seconds, step, steps, loss)
        note = f"{self.decibels:.2f} dB to the {self.against}"
        return Event(stage, seconds, step, steps, loss, rmse_from_psnr(self.decibels), note)


def to_ground_truth(decibels: float | None, views: int) -> Measurement:
    """A measurement against the true edit of so many held-out views."""
    return Measurement(decibels, f"ground truth at {views} held-out cameras")


def to_targets(decibels: float | None) -> Measurement:
    """A measurement against the targets: how far the scene follows them, not how good they are."""
    return Measurement(decibels, "targets it is fitted to (residual)")


def measure_progress(session: Session) -> Measurement:
    """The error of the scene as it is now, at up to three evenly spaced views.

    Against the ground truth at held-out cameras where it is known, otherwise against the targets.
    """
    evaluated = session.request.evaluation_views
    if truths := true_edits(session, _few(evaluated)):
        return to_ground_truth(_mean_psnr(session, truths), len(truths))
    targets = session.progress.edited.targets
    expected = {i: targets[i].image for i in _few(tuple(targets))}
    return to_targets(_mean_psnr(session, expected) if expected else None)


def true_edits(session: Session, views: Sequence[int]) -> dict[int, Float[Tensor, "h w 3"]]:
    """The true edit of these views within the region, by index; nothing where it is unknown."""
    truth = session.progress.edited.ground_truth
    if truth is None:
        return {}
    unedited = {i: session.unedited.picture(i) for i in views}
    return {i: session.within_region(i, truth(image[None])[0]) for i, image in unedited.items()}


def _mean_psnr(session: Session, expected: dict[int, Float[Tensor, "h w 3"]]) -> float:
    """Mean PSNR, dB, of previews of the scene to the expected pictures, of which there are some."""
    values = [psnr(preview(session, i), image) for i, image in expected.items()]
    return sum(values) / len(values)


def _few(indices: Sequence[int]) -> list[int]:
    """At most MAX_PROGRESS_VIEWS of the indices, evenly spaced."""
    return [indices[i] for i in evenly_spaced(len(indices), MAX_PROGRESS_VIEWS)] if indices else []
