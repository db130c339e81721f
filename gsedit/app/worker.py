"""One command line of gsedit at a time, in a process that was started before it was needed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from threading import Lock, Thread
from typing import Any

from gsedit.errors import MOVES, GseditError, Said
from gsedit.runs.events import Event

PATIENCE = 5.0
"""Seconds that a cancelled command has for its checkpoint before it is killed."""
_EVENT_FIELDS = frozenset(each.name for each in fields(Event))


class Cancelled(GseditError):
    """Error of a command that was cancelled."""


@dataclass
class Running:
    """A command in its process."""

    process: subprocess.Popen[str]
    cancelled: bool = False


class Worker:
    """Runs commands, each in a process of its own that has loaded everything already.

    A process ends with its command: nothing is left of it in memory, and killing it harms nothing.
    `program` starts one that reads a JSON list of arguments from its stdin, runs that command, and
    ends itself where stdin closes before.
    """

    def __init__(self, program: Sequence[str]) -> None:
        """Keep the program; nothing is started yet."""
        self._program = tuple(program)
        self._lock = Lock()
        self._spare: subprocess.Popen[str] | None = None
        self._running: Running | None = None
        self._closed = False

    def warm(self) -> None:
        """Start the process of the next command, unless there is one."""
        with self._lock:
            if not self._closed and (self._spare is None or self._spare.poll() is not None):
                self._spare = self._started()

    def run(
        self,
        arguments: Sequence[str],
        on_event: Callable[[Event], None],
        on_line: Callable[[str], None] = lambda line: None,
    ) -> dict[str, Any]:
        """Run a command and return the record of its result; events and messages are handed over
        as they come, in this thread and another.

        Raises Cancelled after `cancel`, and GseditError with the command's own sentence.
        """
        self.warm()
        with self._lock:
            if self._closed or self._spare is None:
                raise Cancelled("the page is closed")
            running = self._running = Running(self._spare)
            self._spare = None
        try:
            told, lines = _conversation(running.process, arguments, on_event, on_line)
        finally:
            with self._lock:
                self._running = None
            self.warm()
        if running.cancelled:
            raise Cancelled("cancelled")
        if code := running.process.returncode:
            raise GseditError(_said(told.get("error"), lines, code))
        return told.get("result", {})

    def cancel(self) -> bool:
        """End the command that runs, if any; it may write a checkpoint first. Whether one ran."""
        with self._lock:
            running = self._running
            if running is None:
                return False
            running.cancelled = True
        _end(running.process)
        return True

    def close(self) -> None:
        """End all processes of the worker."""
        with self._lock:
            self._closed = True
            spare = self._spare
        self.cancel()
        if spare is not None:
            _end(spare)

    def _started(self) -> subprocess.Popen[str]:
        # a session of its own: Ctrl-C in the terminal is the page's to handle
        return subprocess.Popen(
            self._program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, encoding="utf-8", errors="replace", start_new_session=True,
        )  # fmt: skip


def program_of(module: str) -> tuple[str, ...]:
    """The program that runs a module by this Python."""
    return (sys.executable, "-m", module)


def _conversation(
    process: subprocess.Popen[str],
    arguments: Sequence[str],
    on_event: Callable[[Event], None],
    on_line: Callable[[str], None],
) -> tuple[dict[str, Any], list[str]]:
    """Tell a process its arguments and hear it to its end; records by their type, and messages."""
    assert process.stdin is not None
    assert process.stdout is not None
    lines: list[str] = []
    reader = Thread(target=_read_messages, args=(process, lines, on_line), daemon=True)
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
                on_event(Event(**{k: v for k, v in record.items() if k in _EVENT_FIELDS}))
            else:
                told[kind] = record
    process.wait()
    with suppress(OSError):
        process.stdin.close()
    reader.join()
    return told, lines


def _read_messages(
    process: subprocess.Popen[str], lines: list[str], on_line: Callable[[str], None]
) -> None:
    assert process.stderr is not None
    for line in process.stderr:
        if told := line.strip():
            lines.append(told)
            on_line(told)


def _said(error: dict[str, Any] | None, lines: Sequence[str], code: int) -> Said:
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
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        with suppress(ProcessLookupError, PermissionError):
            if os.name == "nt":
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)
