"""Signs of life that ranks leave for each other while they work: one that is gone is noticed in
seconds, also where its machine or the network fails without a word, as sockets do not tell."""

from __future__ import annotations

import threading
import time
from typing import Any

TICK_SECONDS = 0.5
"""How often a rank looks whether another has ended."""
BEAT_TICKS = 6
"""Ticks between two signs of life."""
MISSED_MOST = 10
"""Signs of life that may be missing before a rank counts as gone, 30 s: a busy machine swaps."""
ENDED = "ended"
"""Key that is set when any rank ends early."""
STORE_LOST = "torchrun does not answer: it was killed, or its machine is cut off"
"""Why ranks cannot go on whose store is gone: torchrun holds it."""


class Pulse(threading.Thread):
    """Thread that leaves this rank's signs of life in the store, and looks for the others'.

    It counts its own ticks, not seconds: a program that was stopped and goes on loses nobody.
    """

    def __init__(self, store: Any, rank: int, size: int) -> None:
        super().__init__(daemon=True)
        self.lost = ""
        """Why the work cannot go on: a sentence; "" while it can."""
        self.is_store_lost = False
        """Whether the store does not answer: nothing can be asked of the others."""
        self._store, self._rank = store, rank
        self._beats: dict[int, bytes] = {other: b"" for other in range(size) if other != rank}
        self._missed = dict.fromkeys(self._beats, 0)
        self._done = threading.Event()
        self._ticks = self._seen = self._hung = 0
        self._looked = time.monotonic()

    def look(self) -> str:
        """Say why the work cannot go on, "" while it can; for who waits, to call again and again.

        A store that is cut off lets this thread hang in its last question.
        """
        if (now := time.monotonic()) - self._looked < 2 * TICK_SECONDS:
            return self.lost
        self._hung = self._hung + 1 if self._ticks == self._seen else 0
        self._looked, self._seen = now, self._ticks
        if self._hung > MISSED_MOST * BEAT_TICKS / 2 and not self.lost:
            self._lose_store()
        return self.lost

    def stop(self) -> None:
        """End the thread: the ranks part."""
        self._done.set()
        self.join(2 * TICK_SECONDS)

    def run(self) -> None:
        while not self.lost and not self._done.wait(TICK_SECONDS):
            try:
                if self._store.check([ENDED]):
                    self.lost = self.lost or "another rank ended"
                elif self._ticks % BEAT_TICKS == 0:
                    self._beat(self._ticks)
            except RuntimeError:
                if not self._done.is_set():
                    self._lose_store()
            self._ticks += 1

    def _lose_store(self) -> None:
        self.is_store_lost = True
        self.lost = STORE_LOST

    def _beat(self, tick: int) -> None:
        self._store.set(f"beat/{self._rank}", str(tick))
        for other, before in self._beats.items():
            key = f"beat/{other}"
            now = self._store.get(key) if self._store.check([key]) else b""
            self._missed[other] = 0 if now != before else self._missed[other] + 1
            self._beats[other] = now
            if self._missed[other] > MISSED_MOST:
                self.lost = f"rank {other} gave no sign of life for {self._seconds():g} s"

    def _seconds(self) -> float:
        return MISSED_MOST * BEAT_TICKS * TICK_SECONDS
