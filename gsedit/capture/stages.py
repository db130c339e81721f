"""The stages of a capture: each is named by what it depends on, and kept in one folder.

A stage is complete when its answer, a JSON file, is there; what is beside it without an answer was
interrupted. A run that is started again goes on where the last one was, and one with other photos
or options redoes what depends on them.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from gsedit.capture import child
from gsedit.capture.child import Step
from gsedit.runs.events import Event
from gsedit.storage.atomic import atomic_path
from gsedit.storage.json_files import read_json


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
        task: str = "",
        look: Callable[[], Step] | None = None,
    ) -> Working:
        """The answer of a task of the child process (named like the stage, or `task`), from before
        or from now. `look`: how far a task is that does not say so itself."""
        path = self.answer(stage, key)
        if path.exists():
            yield self.event(stage, 1, 1, "done before")
            return read_json(path, advice="remove it")
        yield self.event(stage)
        request = {**request, "threads": self.threads}
        steps = child.run(task or stage, request, self.log, look)
        last = Step(0, 0)
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
