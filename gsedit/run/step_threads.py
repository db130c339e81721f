"""Fewer threads while other programs take the processors.

The threads of a step wait for the slowest of them many hundred times: where another program has the
processor of one, all stand still until it is that one's turn again. A step that takes a thread
fewer for each that would wait is faster, and so are the other programs.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import torch

TORCH_CHOICE = torch.get_num_threads()
"""Threads that torch takes by itself, if nobody has changed that before this import."""
DECIDED_BY = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which the user decides how many threads torch takes."""
WINDOW_S = 0.5
"""Seconds of steps over which waiting is measured."""
LEAST_WAITING = 0.3
"""Threads that wait for a processor, on the average of a window, above which one is too many. A fit
of two threads on two processors has 0.00 to 0.05 alone, and 0.6 to 0.8 beside a busy loop."""
HOLDS_S = (2.0, 16.0)
"""Seconds with fewer threads, before all are tried again for a window: at first, and at most. They
double while others stay, so that trials take 3 % of the time."""
TASKS = Path("/proc/self/task")
"""Folder of this process's threads, on Linux."""


def waited_seconds(tasks: Path = TASKS) -> float | None:
    """Seconds that the threads of this process were ready but had no processor, summed.

    None where the system does not count them: it is Linux that does.
    """
    waited = None
    with suppress(OSError):
        for task in os.listdir(tasks):
            with suppress(FileNotFoundError):  # a thread has ended
                ready = int((tasks / task / "schedstat").read_text().split()[1])
                waited = (waited or 0.0) + 1e-9 * ready
    return waited


@contextmanager
def on_threads(count: int) -> Iterator[None]:
    """Let torch and the compiled kernels use so many threads until the exit."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class StepThreads:
    """How many threads each of many steps takes: torch's choice, or fewer while others need them.

    Between steps torch has the number that it had before. What the user has decided stays.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        waited: Callable[[], float | None] = waited_seconds,
        choice: int = TORCH_CHOICE,
    ) -> None:
        """`clock`: seconds; `waited`: see `waited_seconds`; `choice`: threads that torch takes by
        itself."""
        self._clock, self._waited, self._choice = clock, waited, choice
        self._fewer, self._hold, self._retry = 0, HOLDS_S[0], 0.0
        self._window = clock(), waited()

    @contextmanager
    def step(self) -> Iterator[None]:
        """Make one step inside, on as many threads as there are processors for."""
        count = torch.get_num_threads()
        told = count != self._choice or any(map(os.environ.get, DECIDED_BY))
        if count == 1 or told:  # the user has said how many there are to be
            yield
            return
        with on_threads(max(1, count - self._fewer)):
            yield
        self._watch(count)

    def _watch(self, count: int) -> None:
        """At the end of a window decide on the threads of the next, of `count`."""
        (began, before), now = self._window, self._clock()
        if now - began < WINDOW_S:
            return
        self._window = now, after = now, self._waited()
        if before is None or after is None:
            return
        waiting = (after - before) / (now - began)
        if waiting > LEAST_WAITING and self._fewer < count - 1:
            self._fewer = min(count - 1, self._fewer + math.ceil(waiting))
            self._retry, self._hold = now + self._hold, min(2 * self._hold, HOLDS_S[1])
        elif self._fewer == 0:
            self._hold = HOLDS_S[0]
        elif now >= self._retry:
            self._fewer = 0
