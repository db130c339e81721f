"""Colors written as #rrggbb."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError


def parse_hex(text: str | None) -> Float64[np.ndarray, "3"]:
    """The display color in [0, 1] of #rrggbb. Raises UsageError."""
    if text is None or not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise UsageError(f"color {text}: give six hexadecimal digits, as in #008080")
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255
