"""Run the schedule of a strategy, from where the session is."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from gsedit.reports.events import Checkpoint, Event
from gsedit.session.actions import Action, LeavesScene
from gsedit.session.session import Session
from gsedit.session.state import Before, session_state


def run_schedule(session: Session, schedule: Iterator[Action]) -> Iterator[Event | Checkpoint]:
    """The actions of the schedule that are not done yet, in order.

    Yields a checkpoint between actions when the settings' `checkpoint_seconds` have passed since
    the last one, when asking the 2D editor fails or is interrupted, and at the end. Raises
    GseditError where ranks no longer take the same decisions.
    """
    request = session.request
    kept, done = session.stopwatch.seconds, session.work.actions
    for action in islice(schedule, session.work.actions, None):
        due = session.stopwatch.seconds - kept >= session.settings.checkpoint_seconds
        if due and session.work.actions > done:
            kept, done = session.stopwatch.seconds, session.work.actions
            yield checkpoint(session)
        yield from _whole(action, session) if isinstance(action, LeavesScene) else action(session)
        session.work.actions += 1
        request.ranks.check_same("the work", (session.work, request.generator.get_state()))
    if session.work.actions > done:
        yield checkpoint(session)


def _whole(action: LeavesScene, session: Session) -> Iterator[Event | Checkpoint]:
    """The action, done or not begun: if it fails, a checkpoint of the session before it is last."""
    before, events = Before(session), 0
    try:
        for event in action(session):
            events += 1
            yield event
    except GeneratorExit:
        raise
    except BaseException:  # Ctrl-C too
        before.restore(session)
        if session.work.actions:
            yield checkpoint(session, undone=events)
        raise


def checkpoint(session: Session, undone: int = 0) -> Checkpoint:
    """Where the session is now; the last `undone` events are of what came to nothing."""
    return Checkpoint(
        session_state(session).along_with(undone=undone),
        session.work.steps,
        session.stopwatch.seconds,
        lambda: session.whole_scene,
    )
