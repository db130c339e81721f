"""Seconds that a measurement can stop, and what both recipes give at a moment."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from rasterizer.scene import Gaussians


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


class Moment(NamedTuple):
    """A fit in progress. It shows the scene as it is: measure it before the fit goes on."""

    seconds: float
    """That the fit took so far."""
    steps: int
    scene: Gaussians
