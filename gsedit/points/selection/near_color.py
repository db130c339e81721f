"""Selections by colour: what looks like a colour that was picked."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32

from gsedit.errors import UsageError
from gsedit.files.table import SplatTable
from gsedit.points.selection.base import Selection
from gsedit.points.selection.volumes import check_positive

TO_XYZ = (
    (0.4124564, 0.3575761, 0.1804375),
    (0.2126729, 0.7151522, 0.0721750),
    (0.0193339, 0.1191920, 0.9503041),
)
"""From linear sRGB, white at D65 (IEC 61966-2-1)."""
_KNEE = 216 / 24389  # CIE 15: above it, the cube root


def lab_of(colors: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """CIE L*a*b* (D65) of sRGB colours, which are clipped to [0, 1]."""
    display = np.clip(colors, 0, 1)
    linear = np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)
    matrix = np.array(TO_XYZ)
    relative = linear @ (matrix / matrix.sum(1, keepdims=True)).T.astype(np.float32)
    f = np.where(relative > _KNEE, np.cbrt(relative), (24389 / 27 * relative + 16) / 116)
    x, y, z = f.T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], 1).astype(np.float32)


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
        picked = lab_of(np.array([self.color], np.float32))
        return np.linalg.norm(lab_of(table.colors) - picked, axis=1) <= self.difference


def parse_color(text: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1, of `#rrggbb` or `#rgb`. Raises UsageError."""
    digits = text.removeprefix("#")
    if not re.fullmatch(r"[0-9a-fA-F]{3}|[0-9a-fA-F]{6}", digits):
        raise UsageError(f"color {text}: give #rrggbb, as in #a08050")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    red, green, blue = (int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return red, green, blue
