"""Tones by their usual amounts."""

from __future__ import annotations

from gsedit.words.instruction import Change

DEFAULT = {"brightness": 0.2, "contrast": 0.25, "saturation": 0.3, "warmth": 0.25, "hue": 1 / 12,
           "shadows": 0.3, "highlights": 0.3, "sharpness": 0.3}  # fmt: skip
"""Share of a tone that is asked for without a number; plain to see, and no color is clipped."""
SLIGHT, STRONG = 0.5, 1.75
"""Shares of it for "a little" and for "much"."""


def tone(name: str, amount: float | None, color: str | None = None) -> Change:
    """Change of a tone of the whole scene."""
    return Change("scene", "tone", name, color, amount, "tone")
