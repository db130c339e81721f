"""Pictures for one tab: the newest camera only, coarse while it moves, full when it rests."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Condition, Thread

import numpy as np

from rasterizer.camera import Camera

SMALL_SCENE, LARGE_SCENE = 300_000, 1_000_000
"""Gaussians of a scene that moves at FAST frames a second, and of one that moves at SLOW."""
FAST, SLOW = 15.0, 5.0
REST = 0.25
"""Seconds without a new camera after which it rests: longer than between two frames of a drag."""
LEAST_SIDE, MOST_SIDE = 256, 1920
"""Longer side of a picture: coarser than the least shows nothing, and finer than the most is seen
by few."""
MOVING_QUALITY, RESTING_QUALITY = 70, 92
"""Qualities of the JPEG pictures."""
HASTE = 0.85
"""Share of the time between two frames that a picture may take: encoding and sending need some."""


def wanted_seconds(count: int) -> float:
    """Seconds from one frame to the next while the camera moves, for so many Gaussians."""
    share = (count - SMALL_SCENE) / (LARGE_SCENE - SMALL_SCENE)
    return 1 / FAST + min(max(share, 0.0), 1.0) * (1 / SLOW - 1 / FAST)


def next_side(side: float, seconds: float, wanted: float, full: int) -> float:
    """The longer side of the next moving picture, after one of `side` pixels took `seconds`.

    Time is taken to grow with the area: the side goes half of the way there in one frame, and
    stays from LEAST_SIDE to `full`.
    """
    ratio = (HASTE * wanted / max(seconds, 1e-4)) ** 0.25
    least = min(LEAST_SIDE, full)
    return float(min(max(side * min(max(ratio, 0.7), 1.25), least), full))


@dataclass(frozen=True)
class Rate:
    """Figures of the last moving frames."""

    side: float = 640.0
    """Longer side of the next one, pixels."""
    frames: int = 0
    seconds: float = 0.0
    """Time that the last one took to draw, to encode and to hand over."""


@dataclass
class Painter:
    """A thread that draws what a tab sees, and sends it."""

    camera: Callable[[], Camera]
    """Returns where the tab looks from now, of the canvas's size. It is asked before each picture,
    after the last word of a move: what a browser tells in pieces may be mixed before."""
    draw: Callable[[Camera], np.ndarray]
    """Returns the picture (h, w, 3), uint8, of a camera; called in the thread."""
    send: Callable[[np.ndarray, int], None]
    """Takes a picture and the quality to encode it with, and sends it."""
    count: Callable[[], int]
    """Returns the number of Gaussians that are shown."""
    fail: Callable[[Exception], None]
    """Takes what drawing raised; the next request is drawn again."""
    rate: Rate = field(default_factory=Rate)
    _moved: float = 0.0
    """When the camera moved last; 0 before the first `look`, until which nothing is drawn."""
    _drawn: tuple[int, bool] = (0, False)
    """The newest request that was drawn, and whether in full."""
    _newest: int = 0
    _ended: bool = False
    _changed: Condition = field(default_factory=Condition)

    def start(self) -> Painter:
        """Begin to draw in a thread."""
        Thread(target=self._run, daemon=True, name="painter").start()
        return self

    def look(self) -> None:
        """Draw from where the camera is now; where it was before may never be drawn."""
        with self._changed:
            self._moved = time.monotonic()
            self._newest += 1
            self._changed.notify()

    def again(self) -> None:
        """Draw what is shown once more: it has changed, and the camera has not."""
        with self._changed:
            self._newest += 1
            self._changed.notify()

    def end(self) -> None:
        """End the thread after the picture in hand."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._ended and not self._due():
                    self._changed.wait(self._patience())
                if self._ended:
                    return
                number, full = self._newest, time.monotonic() - self._moved >= REST
            try:
                self._paint(self.camera(), full)
            except Exception as error:
                self.fail(error)
            with self._changed:
                self._drawn = number, full

    def _due(self) -> bool:
        """Whether a picture is to be drawn now."""
        if not self._moved:
            return False
        number, full = self._drawn
        if number < self._newest:
            return True
        return not full and time.monotonic() - self._moved >= REST

    def _patience(self) -> float | None:
        """Seconds until a camera that has not moved since rests; None where that is drawn."""
        if not self._moved or self._drawn == (self._newest, True):
            return None
        return max(self._moved + REST - time.monotonic(), 0.01)

    def _paint(self, camera: Camera, full: bool) -> None:
        longest = max(camera.width, camera.height)
        most = min(longest, MOST_SIDE)
        side = float(most) if full else min(self.rate.side, float(most))
        began = time.perf_counter()
        picture = self.draw(camera.fitted(round(side)))
        self.send(picture, RESTING_QUALITY if full else MOVING_QUALITY)
        seconds = time.perf_counter() - began
        if not full:
            following = next_side(side, seconds, wanted_seconds(self.count()), most)
            self.rate = replace(
                self.rate, side=following, frames=self.rate.frames + 1, seconds=seconds
            )
