"""Settings of a capture, and the attempts of its retry schedule."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

Lens = Literal["radial", "opencv", "fisheye"]
Mapper = Literal["incremental", "global"]

LENSES = {
    "radial": ("RADIAL", 1, 2),
    "opencv": ("OPENCV", 2, 4),
    "fisheye": ("OPENCV_FISHEYE", 2, 4),
}
"""COLMAP's camera model, its focal lengths, and its distortion parameters."""
EXHAUSTIVE_UP_TO = 80
"""Photos of which every pair is matched. The cost is quadratic: 3,160 pairs, 55 s on two cores."""
EVERY_PAIR_UP_TO = 250
"""Photos of which every pair is matched where neighbors alone did not connect."""
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
    mapper: Mapper = field(default="incremental", metadata={"flag": "--mapper"})
    """COLMAP's incremental mapping, or its global one (GLOMAP), which is faster on hundreds of
    photos and needs good focal lengths."""
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
    exhaustive: bool
    min_angle: float = 16.0
    """Degrees between the rays of the first two photos (COLMAP's default)."""
    min_inliers: int = 100
    """Matches between the first two photos (COLMAP's default)."""
    peak: float = 0.02 / 3
    """Least contrast of a feature (COLMAP's default)."""
    affine: bool = False
    """Affine shapes of features and guided matching: slower, for wide baselines."""


def ladder(settings: CaptureSettings, count: int) -> tuple[tuple[str, Attempt], ...]:
    """Retry schedule for `count` photos, cheapest attempt first, each with its name."""
    every = count <= EXHAUSTIVE_UP_TO
    tried = Attempt(settings.features, every)
    rungs = [("", tried)]
    if not settings.retries:
        return tuple(rungs)
    if settings.mapper == "incremental":
        tried = replace(tried, min_angle=4.0, min_inliers=40)
        rungs.append(("a smaller angle between the first two photos", tried))
    if not every and count <= EVERY_PAIR_UP_TO:
        tried = replace(tried, exhaustive=True)
        rungs.append(("every pair of photos", tried))
    tried = replace(tried, features=2 * tried.features, peak=tried.peak / 3)
    rungs.append(("more and fainter features", tried))
    rungs.append(("affine shapes and guided matching", replace(tried, affine=True)))
    return tuple(rungs)


OVERLAP = 10
"""Neighbors on either side in a sequence (COLMAP's default)."""
BLOCK = 16
"""Photos whose features are held at once: pairs are ordered by blocks."""


def exhaustive(count: int) -> list[tuple[int, int]]:
    """Every pair of `count` photos, once."""
    return _in_blocks({(i, j) for i in range(count) for j in range(i + 1, count)})


def sequential(count: int, overlap: int = OVERLAP) -> list[tuple[int, int]]:
    """Each photo with the `overlap` after it and with those 2^k after it, the last with the first.

    Powers of two reach across the orbit (COLMAP's quadratic overlap); the wrap-around closes it.
    """
    steps = {
        *range(1, overlap + 1),
        *(2**k for k in range(count.bit_length()) if 2**k <= count / 2),
    }
    ends = ((i, (i + step) % count) for i in range(count) for step in steps)
    return _in_blocks({(min(i, j), max(i, j)) for i, j in ends if i != j})


def _in_blocks(pairs: set[tuple[int, int]]) -> list[tuple[int, int]]:
    return sorted(pairs, key=lambda pair: (pair[0] // BLOCK, pair[1] // BLOCK, *pair))
