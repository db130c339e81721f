"""The single-pass update of Efficient-NeRF2NeRF: every view is edited once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsedit.paper.strategies._settings import check_steps

if TYPE_CHECKING:
    from gsedit.paper.actions import Action
    from gsedit.paper.session import Session

NOISE_ALONE = 0.95
"""Strength from which the start of sampling is noise: 1 or 2 % of its variance is a picture
(docs/measurements/fitting.md has the same edit with a solve after each batch)."""


@dataclass(frozen=True)
class SinglePass:
    """Edit a batch of views, fit the scene to all views edited so far, go on with the next batch.

    Colors that are solved for are needed once, after the last batch, unless sampling starts from
    the scene (`strength`). Raises UsageError for fewer than one step.
    """

    update_steps: int = 100
    """Fitting steps after each batch, where the scene is fitted in steps (N_SU of the paper, which
    has 200)."""

    def __post_init__(self) -> None:
        check_steps(self)

    def schedule(self, session: Session) -> Iterator[Action]:
        """Batch by batch of the plan."""
        total = len(session.plan.batches) * self.update_steps
        yield from single_pass(session, self.update_steps, total)


def single_pass(session: Session, update_steps: int, total: int) -> Iterator[Action]:
    """Every batch of the plan once, `update_steps` after each, of `total` in the whole edit.

    Where colors are solved for and no batch starts from the scene as it is then, one solve after
    the last batch does.
    """
    from gsedit.paper.actions import EditViews, fit_round

    batches = session.plan.batches
    request = session.request
    # whether sampling begins at a picture of the scene, and not at hardly more than noise
    is_sampler = request.editor.capabilities.denoiser is not None
    from_scene = is_sampler and request.settings.sampler.strength < NOISE_ALONE
    at_end = request.solves and not from_scene
    for number, batch in enumerate(batches):
        yield EditViews(batch, number + 1, len(batches))
        done = number * update_steps
        if not at_end or number + 1 == len(batches):
            yield from fit_round(session, update_steps, done=done, total=total)
