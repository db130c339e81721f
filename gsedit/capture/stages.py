"""The stages of a capture: each is named by what it depends on, and kept in one folder.

A stage is complete when its answer, a JSON file, is there; what is beside it without an answer was
interrupted. A run that is started again goes on where the last one was, and one with other photos
or options redoes what depends on them.

pycolmap runs in a child process (`worker.py`): torch, loaded first in the same process, can abort
it (colmap/colmap#3477), and a child can be stopped at once. It reads one request as JSON and
answers with JSON lines; what COLMAP prints goes to the log.
"""

from __future__ import annotations

import hashlib
import json
import os
import queue
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import gsedit
from gsedit.errors import GseditError
from gsedit.run.atomic import atomic_path
from gsedit.run.events import Event
from gsedit.run.json_files import read_json


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
    hint = "see its log, and run the command again to go on"
    if code == -9:
        hint = (
            "perhaps the memory ran out: try a smaller --size, and run the command again to go on"
        )
    return f"COLMAP ended during {task} ({how}); {hint}: {log}"


@dataclass(frozen=True)
class Line:
    """Something that the user should know, in one line."""

    text: str
    option: str = ""
    """An option that changes it, for who types some."""


LOG = "colmap.log"
"""COLMAP's log file, in the folder of the stages from the beginning, and a sign that it is one."""

Working: TypeAlias = Generator[Event | Line, None, Any]
"""Work that yields what to show, and returns what it came to."""


def fingerprint(*parts: object) -> str:
    """A short name for whatever a stage depends on."""
    return hashlib.sha256(json.dumps(parts, default=str).encode()).hexdigest()[:12]


class Stages:
    """The folder of the stages, the clock, and which stages this run used."""

    def __init__(self, folder: Path, threads: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        # the child process has another working directory
        self.folder, self.threads = folder.absolute(), threads
        self.log = self.folder / LOG
        self.log.touch()
        self.used = {self.log.name}
        self.began = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.began

    def event(self, stage: str, step: int = 0, steps: int = 0, note: str = "") -> Event:
        return Event(stage, self.seconds, step, steps, note=note)

    def place(self, name: str) -> Path:
        """A path in the folder, kept after this run."""
        self.used.add(name)
        return self.folder / name

    def answer(self, stage: str, key: str) -> Path:
        """Path of a stage's answer: where it exists, the stage is complete."""
        return self.place(f"{stage}-{key}.json")

    def keep(self, stage: str, key: str, answer: object) -> None:
        """Write the answer of a stage, which is complete with it."""
        with atomic_path(self.answer(stage, key), overwrite=True) as temporary:
            temporary.write_text(json.dumps(answer))

    def run(
        self,
        stage: str,
        key: str,
        request: Mapping[str, Any],
        *,
        look: Callable[[], Step] | None = None,
    ) -> Working:
        """The answer of a task of the child process, named like the stage, from before or from now.
        `look`: how far a task is that does not say so itself."""
        path = self.answer(stage, key)
        if path.exists():
            yield self.event(stage, 1, 1, "done before")
            return read_json(path, advice="remove it")
        last = look() if look else Step(0, 0)
        yield self.event(stage, last.step, last.steps, last.note)
        request = {**request, "threads": self.threads}
        steps = run(stage, request, self.log, look)
        try:
            while True:
                step = next(steps)
                if step != last:
                    yield self.event(stage, step.step, step.steps, step.note)
                last = step
        except StopIteration as end:
            self.keep(stage, key, end.value)
            if last.step < last.steps or not last.steps:
                yield self.event(stage, last.steps or 1, last.steps or 1)
            return end.value
        finally:
            steps.close()  # ends the child where the work was interrupted

    def clean(self) -> None:
        """Remove the stages that this run did not use: those of other photos or options."""
        # a database whose last reader was not its last writer still has files of SQLite beside it
        used = {name + suffix for name in self.used for suffix in ("", "-wal", "-shm")}
        for each in self.folder.iterdir():
            if each.name not in used:
                remove(each)


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
