"""Selections by colour: what looks like a colour that was picked."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from gsedit.errors import UsageError
from gsedit.files.table import SplatTable
from gsedit.points.color_space import lab_of_srgb
from gsedit.points.selection.base import Selection
from gsedit.points.selection.volumes import check_positive


@dataclass(frozen=True)
class NearColor(Selection):
    """Whose colour differs from a picked one by at most `difference` (CIE 1976, in Lab).

    About 2 is just noticeable; 10 is a shade, 30 another hue.
    """

    color: tuple[float, float, float]
    """Red, green and blue, 0 to 1."""
    difference: float = 10.0

    def __post_init__(self) -> None:
        check_positive("near", "difference", self.difference)

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        picked = lab_of_srgb(np.array([self.color]))
        return (
            np.linalg.norm(lab_of_srgb(np.clip(table.colors, 0, 1)) - picked, axis=1)
            <= self.difference
        )


def parse_color(text: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1, of `#rrggbb` or `#rgb`. Raises UsageError."""
    digits = text.removeprefix("#")
    if not re.fullmatch(r"[0-9a-fA-F]{3}|[0-9a-fA-F]{6}", digits):
        raise UsageError(f"color {text}: give #rrggbb, as in #a08050")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    red, green, blue = (int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return red, green, blue
