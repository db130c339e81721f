"""What a strategy consists of: asking the 2D editor for views, and fitting the scene to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from gsedit.diffusion import SamplerSettings
from gsedit.reports.events import Event
from gsedit.session.edit_views import ANCHORS, edit_views
from gsedit.session.fit_targets import fit_targets
from gsedit.session.session import Session

STEPS_AT_ONCE = 10
"""Most optimiser steps in one action: an edit can be interrupted between any two actions."""


class Action(Protocol):
    """A part of an edit. All that it changes is in the session."""

    def __call__(self, session: Session) -> Iterator[Event]:
        """Do it; yields what happens."""
        ...


class LeavesScene:
    """Base of actions that do not touch the optimiser: if one fails, the session is as before it,
    and a checkpoint is made of that."""

    def __call__(self, session: Session) -> Iterator[Event]:
        raise NotImplementedError


@runtime_checkable
class OptimiserSteps(Protocol):
    """Steps `first` to `last` (not included) of a round, over which the learning rates fall."""

    @property
    def first(self) -> int: ...

    @property
    def last(self) -> int: ...

    @property
    def round_steps(self) -> int: ...


@dataclass(frozen=True)
class EditViews(LeavesScene):
    """Edit the views with these indices together: batch `step` of `steps`, see `edit_views`."""

    batch: tuple[int, ...]
    step: int
    steps: int
    sampler: SamplerSettings | None = None
    """None: the settings'."""
    anchors: int = ANCHORS

    def __call__(self, session: Session) -> Iterator[Event]:
        yield from edit_views(
            session,
            self.batch,
            step=self.step,
            steps=self.steps,
            sampler=self.sampler,
            anchors=self.anchors,
        )


@dataclass(frozen=True)
class Update:
    """Steps `first` to `last` (not included) of a round of fitting the edited views."""

    first: int
    last: int
    round_steps: int
    """Of the whole round: the learning rates fall over them."""
    done: int
    """Steps of the edit before the round."""
    total: int
    """Steps of the whole edit."""

    def __call__(self, session: Session) -> Iterator[Event]:
        span = range(self.first, self.last)
        yield from fit_targets(session, span, self.round_steps, done=self.done, total=self.total)


def update_round(
    steps: int, *, done: int, total: int, span: range | None = None
) -> Iterator[Update]:
    """A round of `steps`, or the part `span` of it, a few at a time.

    `done` of `total` steps of the edit came before the round.
    """
    span = span or range(steps)
    for first in range(span.start, span.stop, STEPS_AT_ONCE):
        yield Update(first, min(first + STEPS_AT_ONCE, span.stop), steps, done, total)
