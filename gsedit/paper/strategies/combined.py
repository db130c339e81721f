"""The combined method of Efficient-NeRF2NeRF: the single pass, then the iterative update."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.paper.strategies._settings import (
    LEAST_NOISE,
    MOST_NOISE,
    DatasetViews,
    check_noise,
    check_positive,
)
from gsedit.paper.strategies.single_pass import single_pass

if TYPE_CHECKING:
    from gsedit.paper.actions import Action
    from gsedit.paper.session import Session


@dataclass(frozen=True)
class Combined:
    """The single pass first, then the iterative update from the scene that it made.

    The dataset keeps the pictures of the single pass; a view that it left out joins when it is
    edited: unedited pictures would undo the edit. Raises UsageError for a value out of range.
    """

    update_steps: int = 100
    """Fitting steps after each batch of the single pass, where the scene is fitted in steps."""
    further_steps: int = 800
    """Fitting steps of the iterative update (the paper: 800 instead of 3000)."""
    steps_between: int = 10
    """Fitting steps after each view of the iterative update."""
    least_noise: float = LEAST_NOISE
    """Lowest noise level of the iterative update."""
    most_noise: float = MOST_NOISE
    """Highest noise level of the iterative update."""
    dataset_views: DatasetViews = "all"
    """Views that the iterative update edits: all, or those of the plan."""

    def __post_init__(self) -> None:
        check_positive(
            update_steps=self.update_steps,
            further_steps=self.further_steps,
            steps_between=self.steps_between,
        )
        check_noise(self.least_noise, self.most_noise)

    def schedule(self, session: Session) -> Iterator[Action]:
        """Batch by batch of the plan, then a view at a time."""
        from gsedit.paper.strategies._dataset import dataset_views, in_turn

        done = len(session.surveyed.plan.batches) * self.update_steps
        total = done + self.further_steps
        yield from single_pass(session, self.update_steps, total)
        views = dataset_views(session, self.dataset_views)
        noise = (self.least_noise, self.most_noise)
        yield from in_turn(
            session, views, noise, self.further_steps, self.steps_between, done=done, total=total
        )
