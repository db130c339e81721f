"""The iterative dataset update of Instruct-NeRF2NeRF (Haque et al. 2023), the paper's baseline."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.paper.strategies._settings import DatasetUpdate

if TYPE_CHECKING:
    from gsedit.paper.actions import Action
    from gsedit.paper.session import Session


@dataclass(frozen=True, kw_only=True)
class Iterative(DatasetUpdate):
    """Edit one view, fit the scene to all views for a few steps, go on with the next view.

    Algorithm "Iterative Update" of Efficient-NeRF2NeRF. Every edit starts from the scene as it is
    then, noised to a level that is drawn anew, and is conditioned on the unedited picture. Raises
    UsageError for a value out of range.
    """

    total_steps: int = 3000
    """Fitting steps in all (the paper runs Instruct-NeRF2NeRF for 3000)."""

    def schedule(self, session: Session) -> Iterator[Action]:
        """The unedited pictures first, then a view at a time."""
        from gsedit.paper.strategies._dataset import ShowUnedited, dataset_views, in_turn

        yield ShowUnedited(dataset_views(session, self))
        yield from in_turn(session, self, self.total_steps, done=0, total=self.total_steps)
