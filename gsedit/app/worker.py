"""One command line of gsedit at a time, in a process that was started before it was needed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from threading import Event as ThreadEvent
from threading import RLock, Thread
from typing import Any

from gsedit.errors import MOVES, GseditError, Said, UsageError
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch

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
        """One line: the work, how far it is, since when, and how long still, where it knows."""
        stage = "" if self.event is None else self.event.stage
        count = "" if not self.share else f" {100 * self.share:.0f} %"
        known = self.event is not None and self.event.left is not None
        left = f", about {self.event.left:.0f} s left" if self.event and known else ""
        line = f"{self.title}: {stage}{count}, {self.watch.seconds:.0f} s{left}"
        return line.replace(": ,", ",")


_EVENT_FIELDS = frozenset(each.name for each in fields(Event))


class Cancelled(GseditError):
    """Error of a command that was cancelled."""


class Worker:
    """Runs commands one at a time, each in a process of its own that has loaded everything already.

    A process ends with its command: nothing is left of it in memory, and killing it harms nothing.
    `program` starts one that reads a JSON list of arguments from its stdin, runs that command, and
    ends itself where stdin closes before.
    """

    def __init__(self, program: Sequence[str]) -> None:
        """Keep the program; nothing is started yet."""
        self.busy: Work | None = None
        """The command in hand."""
        self.tell: Callable[[], None] = lambda: None
        """Called after each change of `busy`."""
        self._program = tuple(program)
        self._lock = RLock()
        self._spare: subprocess.Popen[str] | None = None
        self._running: subprocess.Popen[str] | None = None
        self._cancelled = self._closed = False
        self._told = Stopwatch()

    def check_idle(self) -> None:
        """Raise UsageError where a command is in hand."""
        if self.busy is not None:
            raise UsageError(f"“{self.busy.title}” is still being done: wait for it, or cancel it")

    def warm(self) -> None:
        """Start the process of the next command, unless there is one."""
        with self._lock:
            if not self._closed and (self._spare is None or self._spare.poll() is not None):
                # a session of its own: Ctrl-C in the terminal is the page's to handle
                self._spare = subprocess.Popen(
                    self._program, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE, text=True, encoding="utf-8", errors="replace",
                    start_new_session=True,
                )  # fmt: skip

    def begin(self, command: Sequence[str], title: str, done: Done, failed: Failed) -> None:
        """Run a command. Then `done` is given the record of its result, or `failed` the error; both
        in a thread, when the next command may begin. Raises UsageError as `check_idle`."""
        with self._lock:
            self.check_idle()
            self.busy, self._cancelled = Work(title, tuple(command), Stopwatch()), False
        self.tell()

        ended = ThreadEvent()

        def tick() -> None:  # the seconds go on where nothing else is told
            while not ended.wait(1.0):
                self.tell()

        def work() -> None:
            try:
                try:
                    record = self.run((*command, "--json"))
                finally:
                    ended.set()
                    self.busy = None
                done(record)
            except Exception as error:
                failed(error)
            self.tell()

        for each in (work, tick):
            Thread(target=each, daemon=True, name=each.__name__).start()

    def run(self, arguments: Sequence[str]) -> dict[str, Any]:
        """Run a command and return the record of its result; events and messages change `busy`.

        Raises Cancelled after `cancel`, and GseditError with the command's own sentence.
        """
        self.warm()
        with self._lock:
            if self._closed or self._cancelled or self._spare is None:
                raise Cancelled("the page is closed" if self._closed else "cancelled")
            running = self._running = self._spare
            self._spare = None
        try:
            told, lines = _conversation(running, arguments, self._change)
        finally:
            with self._lock:
                self._running = None
            self.warm()
        if self._cancelled:
            raise Cancelled("cancelled")
        if code := running.returncode:
            raise GseditError(failure(told.get("error"), lines, code))
        return told.get("result", {})

    def cancel(self) -> None:
        """End the command in hand, if any, also one whose process is only being started; it may
        write a checkpoint first."""
        with self._lock:
            self._change(event=None, line="cancelling…")
            self._cancelled, running = True, self._running
        if running is not None:
            _end(running)

    def close(self) -> None:
        """End all processes of the worker."""
        with self._lock:
            self._closed = True
            spare = self._spare
        self.cancel()
        if spare is not None:
            _end(spare)

    def _change(self, **change: Any) -> None:
        """Note an event or a message of the command in hand, and tell of it now and then."""
        with self._lock:
            if self.busy is None or self._cancelled:
                return
            self.busy = replace(self.busy, **change)
            if self._told.seconds < 0.2:  # seconds between two notices
                return
            self._told = Stopwatch()
        self.tell()


def _conversation(
    process: subprocess.Popen[str], arguments: Sequence[str], hear: Callable[..., None]
) -> tuple[dict[str, Any], list[str]]:
    """Tell a process its arguments and `hear` each event and line of it, to its end; its records by
    their type, and its messages."""
    assert process.stdin is not None
    assert process.stdout is not None
    lines: list[str] = []
    reader = Thread(target=_read_messages, args=(process, lines, hear), daemon=True)
    reader.start()
    with suppress(BrokenPipeError):
        process.stdin.write(json.dumps(list(arguments)) + "\n")
        process.stdin.flush()
    told: dict[str, Any] = {}
    for line in process.stdout:
        with suppress(json.JSONDecodeError):
            record = json.loads(line)
            kind = record.pop("type", "") if isinstance(record, dict) else ""
            if kind == "event":
                hear(event=Event(**{k: v for k, v in record.items() if k in _EVENT_FIELDS}))
            else:
                told[kind] = record
    process.wait()
    with suppress(OSError):
        process.stdin.close()
    reader.join()
    return told, lines


def _read_messages(
    process: subprocess.Popen[str], lines: list[str], hear: Callable[..., None]
) -> None:
    assert process.stderr is not None
    for line in process.stderr:
        if told := line.strip():
            lines.append(told)
            hear(line=told)


def failure(error: dict[str, Any] | None, lines: Sequence[str], code: int) -> Said:
    """Why a command failed: by its own record, or by how it ended."""
    if error is not None and error["move"] in MOVES:
        return Said(error["what"], error["move"], **error["values"])
    if code < 0:
        name = signal.Signals(-code).name
        return Said(
            f"the command was ended by {name}: if that was for memory, close other programs"
        )
    return Said(lines[-1] if lines else f"the command ended with code {code} and said nothing")


def _end(process: subprocess.Popen[str]) -> None:
    """Ask a process to end, and kill it with its children where it does not."""
    process.terminate()
    try:
        process.wait(5.0)  # for its checkpoint, before it is killed
    except subprocess.TimeoutExpired:
        with suppress(ProcessLookupError, PermissionError):
            if os.name == "nt":
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)
