"""Settings of a capture, and the attempts of its retry schedule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

Lens = Literal["radial", "opencv", "fisheye"]
Pair = tuple[int, int]

LENSES = {
    "radial": ("RADIAL", 1, 2),
    "opencv": ("OPENCV", 2, 4),
    "fisheye": ("OPENCV_FISHEYE", 2, 4),
}
"""COLMAP's camera model, its focal lengths, and its distortion parameters."""
FORESTS = 5
"""Spanning forests of the pairs that are matched first: every photo has as many partners or more.
Of the garden's 44 photos 37 have a pose with 3, all with 4; errors are those of all pairs with 5.
"""
MOST_PAIRS = 30_000
"""Pairs that are matched for photos without a pose: all of 245 photos, 15 minutes of one core."""
FEWEST = 3
"""Photos: two leave the depth of every point to two rays, and one cannot be posed."""


@dataclass(frozen=True)
class CaptureSettings:
    """How photos are posed. Every field but the last changes what is computed."""

    frames: int | None = field(default=None, metadata={"flag": "--frames"})
    """Frames to take of a video; an error for photos, which are all used. None: as its length and
    motion ask for."""
    size: int = field(default=1600, metadata={"flag": "--size"})
    """Longer side of the photos that are written, pixels; they are never made larger."""
    features: int = 2048
    """SIFT features of a photo, at most."""
    lens: Lens = field(default="radial", metadata={"flag": "--lens"})
    """Distortion to estimate: radial (k1, k2), opencv (with p1, p2 and two focal lengths), or
    fisheye."""
    focal: float | None = field(default=None, metadata={"flag": "--focal"})
    """Focal length in 35 mm equivalents (a phone's main camera: about 26). None: from EXIF, else
    guessed and refined."""
    retries: bool = field(default=True, metadata={"flag": "--retries"})
    """Try again with other settings where fewer than four of five photos are posed."""
    seed: int = 0
    threads: int = -1
    """CPU threads; -1: all."""

    def __post_init__(self) -> None:
        for name, least in (("frames", FEWEST), ("size", 100), ("features", 100)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise ValueError(f"--{name} is {value}, but must be {least} or more")
        if self.focal is not None and not 1 <= self.focal <= 2000:
            raise ValueError(f"--focal is {self.focal:g}, but must be 1 to 2000 mm")


@dataclass(frozen=True)
class Attempt:
    """Changes that a retry makes."""

    features: int
    peak: float = 0.02 / 3
    """Least contrast of a feature (COLMAP's default)."""
    affine: bool = False
    """Affine shapes of features and guided matching: slower, for wide baselines."""


def ladder(settings: CaptureSettings) -> tuple[tuple[str, Attempt], ...]:
    """Retry schedule, cheapest attempt first, each with its name."""
    first = Attempt(settings.features)
    if not settings.retries:
        return (("", first),)
    more = Attempt(2 * first.features, first.peak / 3)
    affine = replace(more, affine=True)
    names = "", "more and fainter features", "affine shapes and guided matching"
    return tuple(zip(names, (first, more, affine)))


def ranked(common: Sequence[Sequence[int]]) -> list[Pair]:
    """Every pair of photos (i < j), by their features in common (`common[j][i]`), most first; of
    equal ones, those that follow each other sooner."""
    pairs = ((i, j) for j in range(len(common)) for i in range(j))
    return sorted(pairs, key=lambda pair: (-common[pair[1]][pair[0]], pair[1] - pair[0], pair))


def choose(common: Sequence[Sequence[int]], forests: int = FORESTS) -> set[Pair]:
    """The pairs of the best spanning forest (the most features in common), of the best of the pairs
    that are left, and so on: where any photo or group of them leads to others, it does `forests`
    times. The number of pairs grows as the photos do."""
    parents = [list(range(len(common))) for _ in range(forests)]
    chosen = set()
    for i, j in ranked(common):
        for each in parents if common[j][i] else ():
            a, b = _root(each, i), _root(each, j)
            if a != b:
                each[a] = b
                chosen.add((i, j))
                break
    return chosen


def _root(parents: list[int], i: int) -> int:
    while parents[i] != i:
        parents[i] = i = parents[parents[i]]
    return i
