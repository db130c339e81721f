"""Why photos could not be posed, in one line with the next move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsedit.capture.folder import counted
from gsedit.capture.photos import HEIC, Prepared
from gsedit.capture.settings import FEWEST
from gsedit.errors import Said
from gsedit.scene.neighbors import linked

BLACK = 3.0
"""Grey levels: a photo with less contrast shows nothing."""
SAME = 2.0
"""Grey levels that no pixel of a thumbnail differs by: JPEG's noise of one picture."""
FEW_FEATURES = 150
"""SIFT features of a photo in the median: plain walls have less, rooms and gardens thousands."""
STRONG = 60
"""Verified matches of a pair that holds a model together: pairs of 15 are accepted, and may be
chance."""
STILL = 0.003
"""Motion as a share of the picture's width below which matched photos show the same view again."""
TURNED = 0.05
"""Largest median deviation from a rotation of the pairs of a camera that turned on the spot: there
it is 0.007, and 0.27 or more for cameras that walked around a box and around the bear."""
FOCALS = np.geomspace(0.35, 4, 36)
"""Focal lengths that are tried, as shares of the picture's width: 110 degrees to 14."""
NAMED = 3
"""Photos that a message names."""


@dataclass(frozen=True)
class Evidence:
    """Evidence from the stages before mapping."""

    features: Mapping[str, int]
    """SIFT features, by photo."""
    pairs: Sequence[Mapping[str, Any]]
    """Verified pairs: see `worker.survey`."""
    focal_known: bool

    @property
    def turned(self) -> bool:
        """Whether the camera turned and did not walk: homographies that are rotations explain most
        pairs, for one focal length."""
        flat = [np.array(pair["homography"]) for pair in self.pairs if pair["flat"]]
        if len(flat) < max(2, 0.6 * len(self.pairs)):
            return False
        return min(_from_rotation(flat, focal) for focal in FOCALS) < TURNED

    @property
    def still(self) -> bool:
        """Whether most matched points stay where they are."""
        shifts = [pair["shift"] for pair in self.pairs]
        return len(shifts) > 0 and float(np.median(shifts)) < STILL

    def groups(self) -> list[int]:
        """Sizes of the groups of photos that strong pairs connect, the largest first."""
        number = {name: i for i, name in enumerate(self.features)}
        strong = [pair["names"] for pair in self.pairs if pair["inliers"] >= STRONG]
        pairs = np.array([[number[name] for name in names] for names in strong], np.int64)
        groups = np.bincount(linked(pairs.reshape(-1, 2), len(number)))
        return sorted(groups.tolist(), reverse=True)


def _from_rotation(homographies: Sequence[np.ndarray], focal: float) -> float:
    """Median deviation of K^-1 H K from a rotation: of its singular values from 1."""
    scale = np.diag([focal, focal, 1.0])
    inner = np.linalg.inv(scale) @ np.stack(homographies) @ scale
    values = np.linalg.svd(inner, compute_uv=False)
    values /= np.cbrt(values.prod(-1, keepdims=True))
    return float(np.median(np.abs(values - 1).max(-1)))


def before_features(prepared: Prepared, source: object) -> str | None:
    """Why these photos cannot make a scene, whatever is tried; None where they might."""
    photos, left_out = prepared.photos, prepared.unreadable
    if len(photos) < FEWEST:
        if left_out:
            heic = any("(HEIC)" in each for each in left_out)
            small = all("are needed)" in each for each in left_out)
            move = "use the original files" if small else "copy or export these files again"
            lost = f"{counted(len(photos), 'usable photo')} ({listed(left_out)} left out)"
            return f"{source}: {lost}: {HEIC if heic else move}"
        return (
            f"{source}: {counted(len(photos), 'photo')} cannot make a scene: walk around the "
            "subject and take 20 to 100 that overlap"
        )
    black = sum(photo.contrast < BLACK for photo in photos)
    if len(photos) - black < FEWEST:
        return (
            f"{source}: {black} of {len(photos)} photos are black or of one color: check the lens "
            "cap and the exposure, and take them again"
        )
    if max(photo.change for photo in photos) < SAME:
        return (
            f"{source}: all {len(photos)} photos are the same picture: take them from different "
            "places, walking around the subject"
        )
    return None


def hopeless(evidence: Evidence) -> str | None:
    """Why these matches cannot be posed, whatever is tried; None where they might. COLMAP does make
    a model of a camera that only turned: a wrong one."""
    if evidence.still:
        return (
            "the camera hardly moved between the photos: walk around the subject, a step sideways "
            "between photos"
        )
    if evidence.turned:
        return (
            "the camera turned on the spot and did not walk: no depth can be seen; walk around the "
            "subject, a step sideways between photos"
        )
    return None


def cause(evidence: Evidence, count: int, posed: int) -> str:
    """Why only `posed` of `count` photos have a pose, and what to do."""
    features = float(np.median(list(evidence.features.values()) or [0]))
    if features < FEW_FEATURES:
        return (
            f"too little texture ({features:.0f} features a photo): take in more of the "
            "surroundings, put a patterned cloth or newspaper below the subject, use more light"
        )
    groups = evidence.groups() or [0]
    if groups[0] < count and groups[0] <= max(posed, 0.8 * count):
        parts = ", ".join(str(size) for size in groups[:4] if size > 1)
        shown = f"matches connect groups of {parts}" if parts else "no two photos match well"
        return (
            f"too little overlap ({shown}): take photos in between, so that neighbors share two "
            "thirds of the picture"
        )
    if posed < 0.8 * count and not evidence.focal_known:
        what = "the photos match but do not fit together, and their focal length is unknown"
        return Said(what, "focal")
    return (
        "the photos match but do not fit together: leave out what moved or mirrors, or take more "
        "photos from places between"
    )


def listed(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")
