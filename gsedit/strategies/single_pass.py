"""The single-pass update of Efficient-NeRF2NeRF: every view is edited once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gsedit.errors import UsageError
from gsedit.reports.events import Checkpoint, Event
from gsedit.session.edit_views import edit_views
from gsedit.session.fit_targets import checkpoint, fit_targets
from gsedit.session.session import Session


@dataclass(frozen=True)
class SinglePass:
    """Edit a batch of views, fit the scene to all views edited so far, go on with the next batch.

    Raises UsageError for fewer than one step.
    """

    update_steps: int = 100
    """Fitting steps after each batch (N_SU of the paper, which has 200)."""

    def __post_init__(self) -> None:
        if self.update_steps < 1:
            raise UsageError(f"update steps must be 1 or more, not {self.update_steps}")

    def __call__(self, session: Session) -> Iterator[Event | Checkpoint]:
        """Yields events, and a checkpoint after every batch."""
        batches = session.surveyed.plan.rounds
        total = len(batches) * self.update_steps
        for number, batch in enumerate(batches):
            done = number * self.update_steps
            yield from edit_views(session, batch, step=number + 1, steps=len(batches))
            yield from fit_targets(session, self.update_steps, done=done, total=total)
            yield checkpoint(session, done + self.update_steps)
