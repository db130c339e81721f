"""A picture of the views that are being edited, small and before they are done."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import GseditError

if TYPE_CHECKING:
    from gsedit.runs.events import Event

GLIMPSES = "progress.png"
"""The picture's name in the folder of an edit."""
SECONDS = 2.0
"""Least time between two pictures."""
PIXELS = 192
"""Longer side of a view in the picture; it has a pixel for each latent cell."""


class Glimpses:
    """A PNG that is replaced while views are sampled, with the views beside each other."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._written = 0.0

    def show(self, event: Event) -> None:
        """Write the picture of an event that has one, unless one was just written."""
        if event.picture is None or time.monotonic() - self._written < SECONDS:
            return
        from PIL import Image

        from gsedit.formats.pictures import save_picture

        views, height, width = event.picture.shape[:3]
        row = (255 * event.picture).round().byte().movedim(0, 1).reshape(height, -1, 3)
        scale = PIXELS / max(height, width)
        size = round(scale * width) * views, round(scale * height)
        picture = Image.fromarray(row.numpy()).resize(size, Image.Resampling.BILINEAR)
        with suppress(GseditError):  # a full disk must not end the edit
            save_picture(picture, self.path, overwrite=True)
        self._written = time.monotonic()
