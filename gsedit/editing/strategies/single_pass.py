"""The single-pass update of Efficient-NeRF2NeRF: every view is edited once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gsedit.editing.session.actions import Action, EditViews, fit_round
from gsedit.editing.session.session import Session
from gsedit.errors import UsageError


@dataclass(frozen=True)
class SinglePass:
    """Edit a batch of views, fit the scene to all views edited so far, go on with the next batch.

    Raises UsageError for fewer than one step.
    """

    update_steps: int = 100
    """Fitting steps after each batch, where the scene is fitted in steps (N_SU of the paper, which
    has 200)."""

    def __post_init__(self) -> None:
        if self.update_steps < 1:
            raise UsageError(f"update steps must be 1 or more, not {self.update_steps}")

    def schedule(self, session: Session) -> Iterator[Action]:
        """Batch by batch of the plan."""
        total = len(session.surveyed.plan.batches) * self.update_steps
        yield from single_pass(session, self.update_steps, total)


def single_pass(session: Session, update_steps: int, total: int) -> Iterator[Action]:
    """Every batch of the plan once, `update_steps` after each, of `total` in the whole edit."""
    batches = session.surveyed.plan.batches
    for number, batch in enumerate(batches):
        yield EditViews(batch, number + 1, len(batches))
        done = number * update_steps
        yield from fit_round(session, update_steps, done=done, total=total)
