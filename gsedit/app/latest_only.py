"""A thread for short work, in which only the latest request of each kind counts."""

from __future__ import annotations

from collections.abc import Callable
from threading import Condition, Thread
from typing import Any


class LatestOnlyWorker:
    """A thread that does short pieces of work, one at a time.

    A newer request of a key replaces one that waits, and drops the result of one that runs.
    """

    def __init__(self, fail: Callable[[Exception], None]) -> None:
        """Start the thread; `fail` is given what work raises."""
        self._fail = fail
        self._waiting: dict[str, tuple[int, Callable[[], Any], Callable[[Any], None]]] = {}
        self._newest: dict[str, int] = {}
        self._number = 0
        self._ended = False
        self._changed = Condition()
        Thread(target=self._run, daemon=True, name="latest only").start()

    def ask(self, key: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Do `work`, then give what it returns to `then`, both in the thread."""
        with self._changed:
            self._number += 1
            self._newest[key] = self._number
            self._waiting.pop(key, None)  # to the end of the line
            self._waiting[key] = self._number, work, then
            self._changed.notify()

    def drop(self, key: str) -> None:
        """Forget the request of a key: its result is not wanted any more."""
        with self._changed:
            self._waiting.pop(key, None)
            self._newest.pop(key, None)

    def end(self) -> None:
        """End the thread after the work in hand."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ended:
                    self._changed.wait()
                if self._ended:
                    return
                key = next(iter(self._waiting))
                number, work, then = self._waiting.pop(key)
            try:
                value = work()
                with self._changed:
                    wanted = self._newest.get(key) == number and not self._ended
                if wanted:
                    then(value)
            except Exception as error:
                self._fail(error)
