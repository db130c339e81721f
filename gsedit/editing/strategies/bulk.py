"""The dataset update of Instruct-GS2GS (Vachha and Haque 2024): all pictures at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.editing.strategies._settings import (
    MOST_NOISE,
    DatasetViews,
    check_noise,
    check_positive,
)

if TYPE_CHECKING:
    from gsedit.editing.session.actions import Action
    from gsedit.editing.session.session import Session


@dataclass(frozen=True)
class Bulk:
    """Edit all views, fit the scene to them for many steps, and edit them all again.

    Every view is edited on its own, from the scene as it is at the beginning of the round. Raises
    UsageError for a value out of range.
    """

    edit_rounds: int = 3
    """How many times all views are edited (Instruct-GS2GS: 3)."""
    steps_between: int = 250
    """Fitting steps after each round, where the scene is fitted in steps. Instruct-GS2GS has 2500,
    with colors that learn ten times slower."""
    least_noise: float = 0.7
    """Lowest noise level, as Instruct-GS2GS."""
    most_noise: float = MOST_NOISE
    """Highest noise level, a fraction of the schedule."""
    dataset_views: DatasetViews = "all"
    """Views that are edited: all, or those of the plan."""

    def __post_init__(self) -> None:
        check_positive(edit_rounds=self.edit_rounds, steps_between=self.steps_between)
        check_noise(self.least_noise, self.most_noise)

    def schedule(self, session: Session) -> Iterator[Action]:
        """Round by round: no view is edited between the first and the last fitting step of one."""
        from gsedit.editing.session.actions import fit_round
        from gsedit.editing.strategies._dataset import EditAlone, dataset_views

        views = dataset_views(session, self.dataset_views)
        total = self.edit_rounds * self.steps_between
        for number in range(self.edit_rounds):
            for place, view in enumerate(views, start=1):
                yield EditAlone(view, place, len(views), self.least_noise, self.most_noise)
            done = number * self.steps_between
            yield from fit_round(session, self.steps_between, done=done, total=total)
