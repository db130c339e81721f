"""Groups of prepared photos that share a camera, and its known facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.capture.exif import FULL_FRAME_DIAGONAL, Tags, camera_groups
from gsedit.capture.photos import Photo
from gsedit.capture.settings import LENSES, CaptureSettings


@dataclass(frozen=True)
class Group:
    """Prepared photos of one camera."""

    names: tuple[str, ...]
    width: int
    height: int
    focal: float | None
    """Pixels of the prepared photos."""
    source: str
    gravities: Mapping[str, tuple[float, float, float] | None]

    def request(self, lens: str) -> dict[str, Any]:
        """As `worker.extract` takes it."""
        model, focals, distortions = LENSES[lens]
        params = None
        if self.focal is not None:
            middle = [self.width / 2, self.height / 2]
            params = [self.focal] * focals + middle + [0.0] * distortions
        return {"names": self.names, "model": model, "params": params}


def groups_of(photos: Sequence[Photo], settings: CaptureSettings) -> tuple[Group, ...]:
    """The prepared photos by camera."""
    by_source = {Path(photo.source): photo for photo in photos}
    return tuple(
        _group(group, [by_source[path] for path in group], settings)
        for group in camera_groups(list(by_source))
    )


def _group(group: dict[Path, Tags], photos: Sequence[Photo], settings: CaptureSettings) -> Group:
    first, shown = photos[0], next(iter(group.values()))
    focal, source = shown.focal, shown.focal_source
    if settings.focal is not None:
        diagonal = float(np.hypot(shown.width, shown.height))
        focal, source = settings.focal / FULL_FRAME_DIAGONAL * diagonal, "--focal"
    return Group(
        tuple(photo.name for photo in photos), first.width, first.height,
        None if focal is None else focal * first.width / shown.width, source,
        {photo.name: tags.gravity for photo, tags in zip(photos, group.values())},
    )  # fmt: skip
