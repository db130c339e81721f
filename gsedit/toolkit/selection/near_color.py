"""Selections by color: what looks like a color that was picked."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.storage.inputs import existing_file
from gsedit.toolkit.selection.base import QUIET, Selection
from gsedit.toolkit.selection.volumes import check_positive


@dataclass(frozen=True)
class NearColor(Selection):
    """Select colors that differ from a given one by at most `difference` (CIE 1976, in Lab).

    About 2 is just noticeable; 10 is a shade, 30 another hue.
    """

    color: tuple[float, float, float]
    """Red, green and blue, 0 to 1."""
    difference: float = 10.0

    def __post_init__(self) -> None:
        check_positive("near", "difference", self.difference)

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        picked = lab_of_srgb(np.array([self.color]))
        return (
            np.linalg.norm(lab_of_srgb(np.clip(table.colors, 0, 1)) - picked, axis=1)
            <= self.difference
        )


def parse_color(text: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1, of `#rrggbb`, `#rgb`, or of the pixel `PICTURE@COLUMN,ROW`.

    Raises UsageError for another text or a pixel outside, InputError for no picture.
    """
    if "@" in text:
        return _pixel(text)
    digits = text.removeprefix("#")
    if not re.fullmatch(r"[0-9a-fA-F]{3}|[0-9a-fA-F]{6}", digits):
        raise UsageError(f"color {text}: give #rrggbb, as in #a08050, or a pixel, as photo.jpg@8,9")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    red, green, blue = srgb_of_hex(digits).tolist()
    return red, green, blue


def _pixel(text: str) -> tuple[float, float, float]:
    from gsedit.formats.pictures import open_picture

    name, _, place = text.rpartition("@")
    path = existing_file(Path(name).expanduser())
    try:
        column, row = (int(number) for number in place.split(","))
    except ValueError:
        raise UsageError(f"color {text}: name a pixel by column and row: {name}@8,9") from None
    with open_picture(path) as picture:
        shown = np.asarray(picture.convert("RGB"))
    height, width = shown.shape[:2]
    if not (0 <= column < width and 0 <= row < height):
        raise UsageError(f"color {text}: the picture has {width}x{height} pixels, from 0,0")
    red, green, blue = (shown[row, column] / 255).tolist()
    return red, green, blue
