"""What is measured: while an edit goes on, and of its result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.metrics import edit_strength, psnr
from gsedit.reports.events import Event
from gsedit.session.session import Session
from gsedit.views.dataset import View

PROGRESS_VIEWS = 3
"""Held-out views that are measured while the work goes on; all of them are at its end."""


@dataclass(frozen=True)
class EditQuality:
    """What edit.json has under "measured": a new metric is a field here and a line in `assess`."""

    matched: float | None
    """Mean fraction of latent cells matched between two views of a batch; None without any two."""
    pairs: tuple[tuple[str, str, float], ...]
    """(view, view, matched fraction) of every two views that were in a batch together."""
    coverage: float
    """Share of what all views see that the planned views show well, in [0, 1]."""
    strength: float
    """RMSE between renders of the unedited and of the edited scene: 0 is no edit at all."""
    psnr_to_targets: float | None
    """Mean PSNR of the final renders against the edited 2D pictures, dB: how well the scene follows
    them, not how good they are. None where a strategy edits no 2D picture."""
    psnr_to_ground_truth: float | None
    """Mean PSNR to the true edit at the held-out cameras, dB; None where it is unknown."""


@dataclass(frozen=True)
class Measurement:
    """Mean PSNR of the scene's renders, and what they were compared with."""

    decibels: float | None
    """None where there is nothing to compare with."""
    against: str

    def event(
        self, stage: str, seconds: float, step: int = 0, steps: int = 0, loss: float | None = None
    ) -> Event:
        """The measurement as an event of that stage."""
        if self.decibels is None:
            return Event(stage, seconds, step, steps, loss)
        note = f"{self.decibels:.2f} dB to the {self.against}"
        return Event(stage, seconds, step, steps, loss, rmse_from_psnr(self.decibels), note)


def measure(session: Session, views: int = PROGRESS_VIEWS) -> Measurement:
    """The scene as it is now.

    Against the ground truth at the first `views` held-out cameras where it is known, otherwise
    against the edited pictures: how well the scene follows them, not how good they are.
    """
    ground_truth, held_out = session.edited.ground_truth, session.request.held_out
    if ground_truth is not None and held_out:
        cameras = [view.camera for view in held_out[:views]]
        expected = [ground_truth(image[None])[0] for image in session.surveyed.held_out[:views]]
        against = f"ground truth at {len(cameras)} held-out cameras"
    else:
        targets = session.edited.targets.values()
        cameras, expected = [v.camera for v in targets], [v.image for v in targets]
        against = "edited pictures"
    if not cameras:
        return Measurement(None, "nothing")
    decibels = mean(psnr(session.render(c), image) for c, image in zip(cameras, expected))
    return Measurement(decibels, against)


def assess(
    session: Session, originals: Sequence[View], finals: Sequence[View], final: Measurement
) -> EditQuality:
    """Of the result: the same views `originals` before and `finals` after the edit.

    `final` was measured on all held-out views.
    """
    edited = session.edited
    targets = edited.targets.values()
    is_true = edited.ground_truth is not None and session.request.held_out
    return EditQuality(
        matched=mean(share for *_, share in edited.pairs) if edited.pairs else None,
        pairs=tuple(edited.pairs),
        coverage=session.surveyed.plan.coverage[-1],
        strength=mean(edit_strength(a.image, b.image) for a, b in zip(originals, finals)),
        psnr_to_targets=(
            mean(psnr(a.image, b.image) for a, b in zip(finals, targets)) if targets else None
        ),
        psnr_to_ground_truth=final.decibels if is_true else None,
    )


def mean(values: Iterable[float]) -> float:
    """Of one number or more."""
    numbers = [float(value) for value in values]
    return sum(numbers) / len(numbers)
