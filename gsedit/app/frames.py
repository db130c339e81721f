"""Pictures for one tab: one scene, two with a wipe between them, or two beside each other.

Only the newest camera is drawn, coarse while it moves and in full when it rests; of short work
that is asked for meanwhile only the latest of each kind counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Condition, Thread
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from gsedit.formats.pictures import eight_bits
from gsedit.pictures.maps import wipe
from gsedit.select.region import Region, coverage
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.render import render
from rasterizer.scene import Gaussians

BACKGROUND = (0.11, 0.12, 0.14)
"""Behind the scene: dark, and not the black of a hole."""
LINE_PIXELS = 2
"""Width of the line between two scenes."""
LINE, OUTLINE_SHARE = (1.0, 0.72, 0.1), 0.002
"""Color of the line around what is selected or named, and its width in longer sides."""
BESIDE_SCALE = 0.55
"""Size of things where two scenes share the width: between all of them, and as large as before."""

Way = Literal["wipe", "beside"]


@dataclass(frozen=True, eq=False)
class DisplayState:
    """One or two scenes as a tab shows them."""

    scene: Gaussians | None = None
    outlined: Bool[Tensor, " n"] | None = None
    """Gaussians of the scene that a line is drawn around."""
    numerics: Numerics = DEFAULT
    before: Gaussians | None = None
    """The scene to compare with: on the left."""
    way: Way = "wipe"
    wipe: float = 0.5
    """Place of the line from the left, as a share of the picture's width."""

    @property
    def count(self) -> int:
        """Number of the Gaussians that one picture draws."""
        return max((len(each) for each in (self.scene, self.before) if each is not None), default=0)

    def camera(self, camera: Camera) -> Camera:
        """The camera by which the scene is drawn: half as wide, and showing nearly as much, where
        two are beside each other."""
        if self.before is None or self.way == "wipe":
            return camera
        width = max(camera.width // 2, 1)
        fx, fy = BESIDE_SCALE * camera.fx, BESIDE_SCALE * camera.fy
        return replace(camera, fx=fx, fy=fy, cx=width / 2, width=width)


@torch.no_grad()
def picture(shown: DisplayState, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """Draw what is shown; without a scene the background."""
    height, width = camera.height, camera.width
    if shown.scene is None:
        return np.broadcast_to(eight_bits(torch.tensor(BACKGROUND)), (height, width, 3)).copy()
    if shown.before is None:
        drawn = _drawn(shown, shown.scene, camera)
        if shown.outlined is not None:
            drawn = with_outline(drawn, coverage(Region(shown.outlined), shown.scene, camera))
        return eight_bits(drawn)
    background = torch.tensor(BACKGROUND)
    if shown.way == "wipe":
        joined = wipe(
            shown.before, shown.scene, camera, shown.wipe,
            background=background, numerics=(shown.numerics, shown.numerics),
        )  # fmt: skip
        return eight_bits(joined)
    half = shown.camera(camera)
    left, right = (_drawn(shown, each, half) for each in (shown.before, shown.scene))
    joined = torch.cat((left, right, torch.ones(height, width - 2 * half.width, 3)), 1)
    joined[:, max(half.width - LINE_PIXELS // 2, 0) : half.width + LINE_PIXELS // 2] = 1
    return eight_bits(joined)


def with_outline(
    picture: Float[Tensor, "h w 3"], share: Float[Tensor, "h w"]
) -> Float[Tensor, "h w 3"]:
    """The picture with a line around the pixels of which more than half is inside, seen on light
    and on dark: LINE in a dark rim."""
    inside = (share > 0.5).float()[None]
    wide = max(round(max(share.shape) * OUTLINE_SHARE), 1)
    for color, reach in ((torch.zeros(3), wide + 1), (torch.tensor(LINE), wide)):
        grown = torch.nn.functional.max_pool2d(inside, 2 * reach + 1, 1, reach)
        picture = torch.where((grown > inside)[0, ..., None], color.to(picture), picture)
    return picture


def _drawn(shown: DisplayState, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
    background = torch.tensor(BACKGROUND).to(scene.means)
    return render(scene, camera, background=background, numerics=shown.numerics).color


class Loop:
    """A thread that does what is due, one piece at a time, until it is ended."""

    def __init__(self, name: str, fail: Callable[[Exception], None]) -> None:
        """Start the thread; `fail` is given what a piece raises."""
        self._fail = fail
        self._ended = False
        self._changed = Condition()
        Thread(target=self._run, daemon=True, name=name).start()

    def end(self) -> None:
        """End the thread after the piece in hand."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _due(self) -> Callable[[], None] | None:
        """The next piece; None where nothing is due."""
        raise NotImplementedError

    def _patience(self) -> float | None:
        """Seconds until something is due that nobody asks for; None: never."""
        return None

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._ended and (piece := self._due()) is None:
                    self._changed.wait(self._patience())
                if self._ended:
                    return
            try:
                piece()
            except Exception as error:
                self._fail(error)


class LatestOnlyWorker(Loop):
    """A thread that does short pieces of work, one at a time.

    A newer request of a key replaces one that waits, and drops the result of one that runs.
    """

    def __init__(self, fail: Callable[[Exception], None]) -> None:
        """Start the thread; `fail` is given what work raises."""
        self._waiting: dict[str, Callable[[], None]] = {}
        self._newest: dict[str, Callable[[], None]] = {}
        super().__init__("latest only", fail)

    def ask(self, key: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Do `work`, then give what it returns to `then`, both in the thread."""

        def piece() -> None:
            value = work()
            with self._changed:
                wanted = self._newest.get(key) is piece and not self._ended
            if wanted:
                then(value)

        with self._changed:
            self._waiting.pop(key, None)  # to the end of the line
            self._newest[key] = self._waiting[key] = piece
            self._changed.notify()

    def drop(self, key: str) -> None:
        """Forget the request of a key: its result is not wanted any more."""
        with self._changed:
            self._waiting.pop(key, None)
            self._newest.pop(key, None)

    def _due(self) -> Callable[[], None] | None:
        return self._waiting.pop(next(iter(self._waiting))) if self._waiting else None


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


class Painter(Loop):
    """A thread that draws what a tab sees, and sends it."""

    def __init__(
        self, camera: Callable[[], Camera], draw: Callable[[Camera], np.ndarray],
        send: Callable[[np.ndarray, int], None], count: Callable[[], int],
        fail: Callable[[Exception], None],
    ) -> None:  # fmt: skip
        """Start the thread, which draws nothing before the first `look`.

        `camera` returns where the tab looks from now, of the canvas's size. It is asked before each
        picture, after the last word of a move: what a browser tells in pieces may be mixed before.
        `draw` returns the picture (h, w, 3), uint8, of a camera; `send` takes a picture and the
        quality to encode it with; `count` returns the number of Gaussians that are shown. All are
        called in the thread. `fail` takes what one raises: the next request is drawn again.
        """
        self.camera, self.draw, self.send, self.count = camera, draw, send, count
        self.rate = Rate()
        self._moved = 0.0
        """When the camera moved last; 0 before the first `look`."""
        self._newest, self._drawn = 0, (0, False)
        """The newest request, and the newest that was drawn and whether in full."""
        super().__init__("painter", fail)

    def look(self) -> None:
        """Draw from where the camera is now; where it was before may never be drawn."""
        self._moved = time.monotonic()
        self.again()

    def again(self) -> None:
        """Draw what is shown once more: it has changed, and the camera has not."""
        with self._changed:
            self._newest += 1
            self._changed.notify()

    def _due(self) -> Callable[[], None] | None:
        rests, (number, full) = time.monotonic() - self._moved >= REST, self._drawn
        if not self._moved or (number == self._newest and (full or not rests)):
            return None
        newest = self._newest

        def piece() -> None:
            try:
                self._paint(self.camera(), rests)
            finally:
                with self._changed:
                    self._drawn = newest, rests

        return piece

    def _patience(self) -> float | None:
        """Seconds until a camera that has not moved since rests; None where that is drawn."""
        if not self._moved or self._drawn == (self._newest, True):
            return None
        return max(self._moved + REST - time.monotonic(), 0.01)

    def _paint(self, camera: Camera, full: bool) -> None:
        most = min(camera.longest, MOST_SIDE)
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
