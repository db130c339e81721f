"""How far the scene is from what it should become."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.metrics import psnr
from gsedit.reports.events import Event
from gsedit.session.session import Session

PROGRESS_VIEWS = 3
"""Held-out views that are measured while the work goes on; all of them are at its end."""


@dataclass(frozen=True)
class Measurement:
    """Mean PSNR of the scene's renders, and what they were compared with."""

    decibels: float
    against: str

    def event(
        self, stage: str, seconds: float, step: int = 0, steps: int = 0, loss: float | None = None
    ) -> Event:
        """The measurement as an event of that stage."""
        note = f"{self.decibels:.2f} dB to the {self.against}"
        return Event(stage, seconds, step, steps, loss, rmse_from_psnr(self.decibels), note)


def measure(session: Session, views: int = PROGRESS_VIEWS) -> Measurement:
    """The scene as it is now.

    Against the ground truth at the first `views` held-out cameras where it is known, otherwise
    against the edited pictures: a residual, not a quality.
    """
    truth, held_out = session.edited.ground_truth, session.request.held_out
    if truth is not None and held_out:
        cameras = [view.camera for view in held_out[:views]]
        expected = [truth(image[None])[0] for image in session.surveyed.held_out[:views]]
        against = f"ground truth at {len(cameras)} held-out cameras"
    else:
        targets = session.edited.targets.values()
        cameras, expected = [v.camera for v in targets], [v.image for v in targets]
        against = "edited pictures"
    decibels = mean(psnr(session.render(c), image) for c, image in zip(cameras, expected))
    return Measurement(decibels, against)


def mean(values: Iterable[float]) -> float:
    """Of one number or more."""
    numbers = [float(value) for value in values]
    return sum(numbers) / len(numbers)
