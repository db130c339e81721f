"""Lights by name, as a table of data."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.light.setup import LEAST, MOST, Fog, Lamp, LightSetup, Sun
from gsedit.scene.color_space import linear_of_srgb
from gsedit.words.direct import light_of

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


LOW_SUN = (1.0, 0.52, 0.2)
WARM = (1.0, 0.72, 0.42)
FLAME = (1.0, 0.5, 0.16)
MOON = (0.5, 0.72, 1.0)
MIST = (0.8, 0.82, 0.84)

LIGHTS: dict[str, LightSetup] = {
    "night": LightSetup(
        (0.026, 0.052, 0.125), (0.009, 0.015, 0.032), Sun(-60.0, 45.0, 0.1, MOON, 3.0),
        saturation=0.45, deep=True, backdrop=(0.04, 0.06, 0.13),
    ),
    "moonlight": LightSetup(
        (0.015, 0.034, 0.09), (0.006, 0.01, 0.023), Sun(-100.0, 38.0, 0.42, MOON, 1.0),
        saturation=0.35, backdrop=(0.05, 0.08, 0.17),
    ),
    "dusk": LightSetup(
        (0.2, 0.2, 0.32), (0.06, 0.05, 0.06), Sun(-80.0, 6.0, 0.1, (1.0, 0.45, 0.3), 10.0),
        saturation=0.8, deep=True, backdrop=(0.5, 0.4, 0.5),
    ),
    "blue hour": LightSetup(
        (0.14, 0.21, 0.42), (0.04, 0.05, 0.08), saturation=0.75, deep=True,
        backdrop=(0.22, 0.32, 0.58),
    ),
    "sunset": LightSetup(
        (0.15, 0.13, 0.2), (0.07, 0.04, 0.03), Sun(-75.0, 12.0, 1.6, LOW_SUN, 2.0),
        backdrop=(0.98, 0.66, 0.42),
    ),
    "golden hour": LightSetup(
        (0.22, 0.2, 0.24), (0.12, 0.08, 0.05), Sun(-60.0, 22.0, 1.5, (1.0, 0.7, 0.36), 2.0),
        backdrop=(1.0, 0.86, 0.66),
    ),
    "sunrise": LightSetup(
        (0.2, 0.19, 0.26), (0.09, 0.06, 0.05), Sun(70.0, 12.0, 1.3, (1.0, 0.62, 0.42), 3.0),
        backdrop=(0.98, 0.78, 0.7),
    ),
    "sunny": LightSetup(
        (0.24, 0.27, 0.32), (0.12, 0.11, 0.09), Sun(-55.0, 46.0, 1.2, (1.0, 0.95, 0.86), 1.0),
        backdrop=(0.55, 0.74, 0.95),
    ),
    "noon": LightSetup(
        (0.16, 0.2, 0.27), (0.14, 0.12, 0.1), Sun(-20.0, 76.0, 1.15, (1.0, 0.97, 0.92), 1.0),
        backdrop=(0.5, 0.71, 0.95),
    ),
    "daylight": LightSetup(
        (0.55, 0.6, 0.68), (0.2, 0.18, 0.16), Sun(-45.0, 50.0, 0.7, (1.0, 0.96, 0.9), 4.0),
    ),
    "cloudy": LightSetup((0.68, 0.73, 0.8), (0.17, 0.17, 0.17), saturation=0.78,
        backdrop=(0.74, 0.77, 0.8),
    ),
    "storm": LightSetup(
        (0.27, 0.32, 0.36), (0.07, 0.08, 0.08), saturation=0.55,
        fog=Fog((0.33, 0.37, 0.4), 0.35), backdrop=(0.34, 0.38, 0.42),
    ),
    "fog": LightSetup(
        (0.85, 0.87, 0.9), (0.3, 0.3, 0.3), saturation=0.75, fog=Fog(MIST, 1.4, 0.25, 0.16),
        backdrop=MIST,
    ),
    "lamp": LightSetup(
        (0.05, 0.055, 0.07), (0.02, 0.02, 0.02), lamps=(Lamp(-15.0, 75.0, 1.5, WARM),),
        backdrop=(0.05, 0.05, 0.08),
    ),
    "spotlight": LightSetup(
        (0.02, 0.022, 0.03), (0.01, 0.01, 0.01),
        lamps=(Lamp(-25.0, 62.0, 1.9, (1.0, 0.96, 0.88), 1.2, 20.0),), backdrop=(0.03, 0.03, 0.05),
    ),
    "candlelight": LightSetup(
        (0.035, 0.025, 0.025), (0.02, 0.012, 0.008),
        lamps=(Lamp(-35.0, 12.0, 0.75, FLAME, 0.6, 60.0), Lamp(150.0, 20.0, 0.2, FLAME, 0.8, 60.0)),
        backdrop=(0.06, 0.04, 0.03),
    ),
    "studio light": LightSetup(
        (0.06, 0.06, 0.065), (0.05, 0.05, 0.05),
        lamps=(
            Lamp(-45.0, 40.0, 1.4, (1.0, 0.97, 0.93), 1.2, 40.0),
            Lamp(55.0, 20.0, 0.35, (0.9, 0.95, 1.0), 1.3, 40.0),
            Lamp(170.0, 45.0, 0.6, (1.0, 1.0, 1.0), 1.1, 35.0),
        ),
        backdrop=(0.2, 0.2, 0.21),
    ),
    "backlight": LightSetup(
        (0.13, 0.13, 0.15), (0.05, 0.045, 0.04), Sun(170.0, 24.0, 2.6, (1.0, 0.86, 0.66), 2.0),
        backdrop=(1.0, 0.94, 0.84),
    ),
    "neon": LightSetup(
        (0.03, 0.03, 0.07), (0.02, 0.01, 0.03),
        lamps=(
            Lamp(-75.0, 25.0, 1.1, (1.0, 0.08, 0.62), 0.9, 60.0),
            Lamp(75.0, 25.0, 1.0, (0.05, 0.7, 1.0), 0.9, 60.0),
            Lamp(180.0, 30.0, 0.7, (0.45, 0.1, 1.0), 1.0, 60.0),
        ),
        backdrop=(0.08, 0.04, 0.16),
    ),
    "underwater light": LightSetup(
        (0.1, 0.42, 0.52), (0.02, 0.1, 0.14), Sun(-30.0, 70.0, 0.25, (0.35, 0.9, 1.0), 6.0),
        saturation=0.7, fog=Fog((0.03, 0.27, 0.36), 1.0, 0.1, 0.2), backdrop=(0.1, 0.42, 0.52),
    ),
}  # fmt: skip
"""Lights by the names that `gsedit.words` gives them."""


def setup_of(
    name: str, amount: float | None = None, color: Float64[np.ndarray, "3"] | None = None
) -> LightSetup:
    """The setup that a change asks for: "sunset from the left", or a lamp of a display color.

    An amount is a signed share of the light's strength, of fog its density. Raises UsageError for
    an unknown name or an amount out of range.
    """
    light = light_of(name)
    if light not in LIGHTS:
        raise UsageError(f"there is no light {name!r}: choose one of {', '.join(LIGHTS)}")
    setup = LIGHTS[light].turned(*direction_of(name[len(light) :]))
    if amount is not None:
        if not LEAST <= amount <= MOST:
            raise UsageError(
                f"{name} by {amount:+.0%} is out of range: say a share from {LEAST:+.0%} to "
                f"{MOST:+.0%}"
            )
        setup = setup.scaled(1 + amount)
    return setup if color is None else setup.colored(linear_of_srgb(color))
