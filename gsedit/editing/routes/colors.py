"""Colors written as #rrggbb."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.scene.color_space import srgb_of_hex


def parse_hex(text: str | None) -> Float64[np.ndarray, "3"]:
    """The display color in [0, 1] of #rrggbb. Raises UsageError."""
    if text is None or not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise UsageError(f"color {text}: give six hexadecimal digits, as in #008080")
    return srgb_of_hex(text)
