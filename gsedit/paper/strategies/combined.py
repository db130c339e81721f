"""The combined method of Efficient-NeRF2NeRF: the single pass, then the iterative update."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.paper.strategies._settings import DatasetUpdate
from gsedit.paper.strategies.single_pass import single_pass

if TYPE_CHECKING:
    from gsedit.paper.actions import Action
    from gsedit.paper.session import Session


@dataclass(frozen=True, kw_only=True)
class Combined(DatasetUpdate):
    """The single pass first, then the iterative update from the scene that it made.

    The dataset keeps the pictures of the single pass; a view that it left out joins when it is
    edited: unedited pictures would undo the edit. Raises UsageError for a value out of range.
    """

    update_steps: int = 100
    """Fitting steps after each batch of the single pass, where the scene is fitted in steps."""
    further_steps: int = 800
    """Fitting steps of the iterative update (the paper: 800 instead of 3000)."""

    def schedule(self, session: Session) -> Iterator[Action]:
        """Batch by batch of the plan, then a view at a time."""
        from gsedit.paper.strategies._dataset import in_turn

        done = len(session.plan.batches) * self.update_steps
        total = done + self.further_steps
        yield from single_pass(session, self.update_steps, total)
        yield from in_turn(session, self, self.further_steps, done=done, total=total)
