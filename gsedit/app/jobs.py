"""Commands of the page as jobs, one at a time: begun, watched, cancelled."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import RLock, Thread
from typing import Any

from gsedit.app.worker import Worker
from gsedit.errors import UsageError
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch

BETWEEN_NOTICES = 0.2
"""Seconds between two notices of progress."""
BETWEEN_TRIES = 0.02
"""Seconds between two tries to cancel a command that is being started."""
Done = Callable[[dict[str, Any]], None]
Failed = Callable[[Exception], None]


@dataclass(frozen=True)
class Work:
    """The command in hand."""

    title: str
    command: tuple[str, ...]
    watch: Stopwatch
    event: Event | None = None
    line: str = ""
    """The last message of the command."""

    @property
    def share(self) -> float | None:
        """How much of the stage in hand is done, in [0, 1]; None where that is not known."""
        event = self.event
        return None if event is None or not event.steps else min(event.step / event.steps, 1.0)

    def describe(self) -> str:
        """One line: the work, how far it is, and since when."""
        stage = "" if self.event is None else self.event.stage
        count = "" if not self.share else f" {100 * self.share:.0f} %"
        return f"{self.title}: {stage}{count}, {self.watch.seconds:.0f} s".replace(": ,", ",")


class JobRunner:
    """Runs commands of the worker one at a time, in a thread."""

    def __init__(self, worker: Worker, tell: Callable[[], None]) -> None:
        """Take the worker; `tell` is called after each change of `busy`."""
        self.worker = worker
        self.busy: Work | None = None
        self._tell = tell
        self._told = Stopwatch()
        self._lock = RLock()

    def check_idle(self) -> None:
        """Raise UsageError where a command is in hand."""
        if self.busy is not None:
            raise UsageError(f"“{self.busy.title}” is still being done: wait for it, or cancel it")

    def begin(self, command: Sequence[str], title: str, done: Done, failed: Failed) -> None:
        """Run a command. Then `done` is given the record of its result, or `failed` the error; both
        in a thread, when the next command may begin. Raises UsageError as `check_idle`."""
        with self._lock:
            self.check_idle()
            self.busy = work = Work(title, tuple(command), Stopwatch())
        self._tell()
        Thread(target=self._run, args=(work, done, failed), daemon=True, name="work").start()

    def cancel(self) -> None:
        """End the command in hand, if any, also one whose process is only being started."""
        work = self.busy
        while work is not None and (now := self.busy) is not None and now.watch is work.watch:
            if self.worker.cancel():
                return
            time.sleep(BETWEEN_TRIES)

    def _run(self, work: Work, done: Done, failed: Failed) -> None:
        try:
            try:
                record = self.worker.run((*work.command, "--json"), self._on_event, self._on_line)
            finally:
                self.busy = None
            done(record)
        except Exception as error:
            failed(error)
        self._tell()

    def _on_event(self, event: Event) -> None:
        self._change(lambda work: replace(work, event=event))

    def _on_line(self, line: str) -> None:
        self._change(lambda work: replace(work, line=line))

    def _change(self, change: Callable[[Work], Work]) -> None:
        with self._lock:
            if self.busy is None:
                return
            self.busy = change(self.busy)
            if self._told.seconds < BETWEEN_NOTICES:
                return
            self._told = Stopwatch()
        self._tell()
