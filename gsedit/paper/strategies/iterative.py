"""The iterative dataset update of Instruct-NeRF2NeRF (Haque et al. 2023), the paper's baseline."""

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

if TYPE_CHECKING:
    from gsedit.paper.actions import Action
    from gsedit.paper.session import Session


@dataclass(frozen=True)
class Iterative:
    """Edit one view, fit the scene to all views for a few steps, go on with the next view.

    Algorithm "Iterative Update" of Efficient-NeRF2NeRF. Every edit starts from the scene as it is
    then, noised to a level that is drawn anew, and is conditioned on the unedited picture. Raises
    UsageError for a value out of range.
    """

    total_steps: int = 3000
    """Fitting steps in all (the paper runs Instruct-NeRF2NeRF for 3000)."""
    steps_between: int = 10
    """Fitting steps after each edited view (N_IU of the paper)."""
    least_noise: float = LEAST_NOISE
    """Lowest noise level at which an edit starts, a fraction of the schedule."""
    most_noise: float = MOST_NOISE
    """Highest noise level at which an edit starts, a fraction of the schedule."""
    dataset_views: DatasetViews = "all"
    """Views that are edited in turn: all but the held-out ones, or those of the plan."""

    def __post_init__(self) -> None:
        check_positive(total_steps=self.total_steps, steps_between=self.steps_between)
        check_noise(self.least_noise, self.most_noise)

    def schedule(self, session: Session) -> Iterator[Action]:
        """The unedited pictures first, then a view at a time."""
        from gsedit.paper.strategies._dataset import ShowUnedited, dataset_views, in_turn

        views = dataset_views(session, self.dataset_views)
        yield ShowUnedited(views)
        noise = (self.least_noise, self.most_noise)
        total = self.total_steps
        yield from in_turn(session, views, noise, total, self.steps_between, done=0, total=total)
