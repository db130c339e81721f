"""Directions of light in words: "sunset from the left"."""

from __future__ import annotations

import re

SIDES: dict[str, tuple[float | None, float | None]] = {
    r"behind (?:me|us|the camera)|over my shoulder": (0.0, None),
    r"left": (-75.0, None),
    r"right": (75.0, None),
    r"behind|back": (170.0, None),
    r"front": (0.0, None),
    r"above|over|overhead|top": (None, 80.0),
    r"below|beneath|under(?:neath)?": (None, -35.0),
    r"low": (None, 8.0),
}
"""Azimuth and elevation, degrees (see gsedit.light.setup), by the words that say them; None: as
the light has it. The first that is found counts."""


def direction_of(words: str) -> tuple[float | None, float | None]:
    """Azimuth and elevation that words give a light; None where they say nothing of it."""
    azimuth = elevation = None
    for pattern, (turn, rise) in SIDES.items():
        if re.search(rf"\b(?:{pattern})\b", words.lower()):
            azimuth = turn if azimuth is None else azimuth
            elevation = rise if elevation is None else elevation
    return azimuth, elevation
