"""Seconds that a measurement can stop, so that what it measures does not pay for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Clock:
    """Call it for the seconds since its construction, without those in which it was `paused`."""

    def __init__(self, read: Callable[[], float] = time.monotonic) -> None:
        self._read = read
        self._began = read()

    def __call__(self) -> float:
        return self._read() - self._began

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock: work inside takes no time."""
        stopped = self._read()
        try:
            yield
        finally:
            self._began += self._read() - stopped
