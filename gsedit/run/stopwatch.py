"""Wall-clock seconds of long work, whole and per stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager


class Stopwatch:
    """Runs from its construction, on from what was spent before."""

    def __init__(
        self,
        spent: float = 0.0,
        stages: Mapping[str, float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._began = clock() - spent
        self.stages: dict[str, float] = dict(stages or {})
        """Seconds spent in each stage so far, summed over its visits."""

    @property
    def seconds(self) -> float:
        """Since the construction, with what was spent before."""
        return self._clock() - self._began

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time until its exit, also by an exception, to `stages[name]`."""
        entered = self._clock()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + self._clock() - entered


def duration(seconds: float) -> str:
    """A time for a person: 40 s, 12 min, 3.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
