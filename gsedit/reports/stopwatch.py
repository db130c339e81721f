"""Wall-clock seconds of long work, whole and per stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Runs from its construction."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self.stages: dict[str, float] = {}
        """Seconds spent in each stage so far, summed over its visits."""

    @property
    def seconds(self) -> float:
        """Since the construction."""
        return time.monotonic() - self._began

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time until its exit, also by an exception, to `stages[name]`."""
        entered = time.monotonic()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.monotonic() - entered
