"""Run the schedule of a strategy, from where the session is."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import torch

from gsedit.reports.events import Checkpoint, Event
from gsedit.session.actions import Action, EditViews
from gsedit.session.session import Session


def run_schedule(session: Session, schedule: Iterator[Action]) -> Iterator[Event | Checkpoint]:
    """The actions of the schedule that are not done yet, in order.

    Yields a checkpoint when the settings' `checkpoint_seconds` have passed since the last one,
    before the 2D editor is asked (it may be slow, or fail), and at the end.
    """
    kept, steps = session.stopwatch.seconds, session.work.steps
    for action in islice(schedule, session.work.actions, None):
        due = session.stopwatch.seconds - kept >= session.settings.checkpoint_seconds
        if session.work.steps > steps and (due or isinstance(action, EditViews)):
            kept, steps = session.stopwatch.seconds, session.work.steps
            yield checkpoint(session)
        yield from action(session)
        session.work.actions += 1
    if session.work.steps > steps:
        yield checkpoint(session)


def checkpoint(session: Session) -> Checkpoint:
    """A copy of the scene as it is now."""
    scene = session.scene.map(torch.clone)
    return Checkpoint(scene, session.work.steps, session.stopwatch.seconds)
