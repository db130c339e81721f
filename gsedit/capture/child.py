"""pycolmap in a child process: torch, loaded first in the same process, can abort it
(colmap/colmap#3477), and a child can be stopped at once.

The child (`worker.py`) reads one request as JSON and answers with JSON lines. What COLMAP prints
goes to the log.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gsedit
from gsedit.errors import GseditError, Said
from gsedit.storage.atomic import atomic_path


@dataclass(frozen=True)
class Step:
    """How far a task is."""

    step: int
    steps: int
    note: str = ""


POLL = 0.3
"""Seconds between looks at how far a task is."""


def run(
    task: str, request: Mapping[str, Any], log: Path, look: Callable[[], Step] | None = None
) -> Generator[Step, None, dict[str, Any]]:
    """Run a task of `worker.py`; yields its steps and returns its answer. `look` tells how far a
    task is that does not say so itself.

    Closing the generator, or an exception in it (Ctrl-C), ends the child. Raises GseditError where
    the child failed.
    """
    root = Path(gsedit.__file__).parents[1]
    with log.open("a") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "gsedit.capture.worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True,
            encoding="utf-8", cwd=root, start_new_session=True,
            env={**os.environ, "PYTHONIOENCODING": "utf-8", "GLOG_logtostderr": "1"},
        )  # fmt: skip
    assert process.stdin
    assert process.stdout
    try:
        process.stdin.write(json.dumps({"task": task, **request}) + "\n")
        process.stdin.flush()  # left open: the child ends where it closes, as ours does when killed
        for line in _lines(process.stdout):
            if not line:
                if look is not None:
                    yield look()
                continue
            record = json.loads(line)
            match record.pop("type"):
                case "step":
                    yield Step(**record)
                case "error":
                    raise GseditError(f"{task}: {record['message']} (COLMAP's log: {log})")
                case "done":
                    return record
        raise GseditError(_died(task, process.wait(), log))
    except BrokenPipeError:
        raise GseditError(_died(task, process.wait(), log)) from None
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        with suppress(BrokenPipeError):  # what it was sent and did not read
            process.stdin.close()


def _lines(stream: Iterable[str]) -> Iterator[str]:
    """The lines of a stream; "" where none came for POLL seconds. Ctrl-C is heard meanwhile."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        with suppress(ValueError):  # closed by `run`
            for line in stream:
                lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=POLL)
        except queue.Empty:
            yield ""
            continue
        if line is None:
            return
        yield line


def rows(database: Path, table: str) -> int:
    """Rows of a table of a database that a child writes to.

    Not to be called in the process that writes: SQLite's locks do not hold between two copies of
    the library in one process, and COLMAP brings its own.
    """
    with suppress(sqlite3.Error), closing(_reader(database)) as connection:
        return connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]
    return 0  # not there yet, or locked


def copy_database(database: Path, copy: Path) -> None:
    """Copy a database with what its write-ahead log still holds, whole or not at all."""
    with (
        atomic_path(copy) as temporary,
        closing(_reader(database)) as source,
        closing(sqlite3.connect(temporary)) as target,
    ):
        source.backup(target)


def _reader(database: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True, timeout=1)


def _died(task: str, code: int, log: Path) -> str:
    how = f"exit code {code}"
    if code < 0:
        how = signal.Signals(-code).name
    what = f"COLMAP ended during {task} ({how})"
    if code == -9:
        return Said(f"{what}, see {log}; perhaps the memory ran out", "memory-again")
    return f"{what}; see its log, and run the command again to go on: {log}"
