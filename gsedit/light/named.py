"""Lights by name, as a table of data."""

from __future__ import annotations

from gsedit.errors import UsageError
from gsedit.light.setup import Fog, Lamp, LightSetup, Sun

LOW_SUN = (1.0, 0.52, 0.2)
WARM = (1.0, 0.72, 0.42)
FLAME = (1.0, 0.5, 0.16)
MOON = (0.62, 0.78, 1.0)
MIST = (0.8, 0.82, 0.84)

LIGHTS: dict[str, LightSetup] = {
    "night": LightSetup(
        (0.05, 0.075, 0.14), (0.015, 0.02, 0.035), Sun(-50, 50, 0.07, MOON, 4),
        saturation=0.45, backdrop=(0.04, 0.06, 0.13),
    ),
    "moonlight": LightSetup(
        (0.035, 0.055, 0.11), (0.012, 0.016, 0.03), Sun(-65, 42, 0.26, MOON, 1.5),
        saturation=0.35, backdrop=(0.05, 0.08, 0.17),
    ),
    "dusk": LightSetup(
        (0.2, 0.2, 0.32), (0.06, 0.05, 0.06), Sun(-80, 6, 0.1, (1.0, 0.45, 0.3), 10),
        saturation=0.8, backdrop=(0.5, 0.4, 0.5),
    ),
    "blue hour": LightSetup(
        (0.14, 0.21, 0.42), (0.04, 0.05, 0.08), saturation=0.75, backdrop=(0.22, 0.32, 0.58),
    ),
    "sunset": LightSetup(
        (0.24, 0.2, 0.27), (0.1, 0.06, 0.04), Sun(-75, 11, 1.5, LOW_SUN, 2),
        backdrop=(0.98, 0.66, 0.42),
    ),
    "golden hour": LightSetup(
        (0.36, 0.32, 0.34), (0.16, 0.11, 0.07), Sun(-60, 20, 1.5, (1.0, 0.7, 0.36), 2),
        backdrop=(1.0, 0.86, 0.66),
    ),
    "sunrise": LightSetup(
        (0.34, 0.3, 0.36), (0.12, 0.08, 0.07), Sun(70, 12, 1.2, (1.0, 0.62, 0.42), 3),
        backdrop=(0.98, 0.78, 0.7),
    ),
    "sunny": LightSetup(
        (0.34, 0.42, 0.54), (0.14, 0.12, 0.1), Sun(-50, 48, 1.25, (1.0, 0.95, 0.86), 1),
        backdrop=(0.55, 0.74, 0.95),
    ),
    "noon": LightSetup(
        (0.32, 0.39, 0.48), (0.18, 0.16, 0.13), Sun(-20, 76, 1.3, (1.0, 0.97, 0.92), 1),
        backdrop=(0.5, 0.71, 0.95),
    ),
    "daylight": LightSetup(
        (0.55, 0.6, 0.68), (0.2, 0.18, 0.16), Sun(-45, 50, 0.7, (1.0, 0.96, 0.9), 4),
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
        (0.05, 0.055, 0.07), (0.02, 0.02, 0.02), lamps=(Lamp(-15, 75, 1.5, WARM),),
        backdrop=(0.05, 0.05, 0.08),
    ),
    "candlelight": LightSetup(
        (0.035, 0.025, 0.025), (0.02, 0.012, 0.008),
        lamps=(Lamp(-35, 12, 0.75, FLAME, 0.6, 60), Lamp(150, 20, 0.2, FLAME, 0.8, 60)),
        backdrop=(0.06, 0.04, 0.03),
    ),
    "studio": LightSetup(
        (0.16, 0.16, 0.17), (0.1, 0.1, 0.1),
        lamps=(
            Lamp(-45, 40, 1.1, (1.0, 0.97, 0.93), 1.2, 40),
            Lamp(55, 20, 0.35, (0.9, 0.95, 1.0), 1.3, 40),
            Lamp(170, 45, 0.6, (1.0, 1.0, 1.0), 1.1, 35),
        ),
        backdrop=(0.3, 0.3, 0.32),
    ),
    "backlight": LightSetup(
        (0.3, 0.3, 0.33), (0.1, 0.09, 0.08), Sun(170, 24, 1.9, (1.0, 0.86, 0.66), 2),
        backdrop=(1.0, 0.94, 0.84),
    ),
    "neon": LightSetup(
        (0.03, 0.03, 0.07), (0.02, 0.01, 0.03),
        lamps=(
            Lamp(-75, 25, 1.1, (1.0, 0.08, 0.62), 0.9, 60),
            Lamp(75, 25, 1.0, (0.05, 0.7, 1.0), 0.9, 60),
            Lamp(180, 30, 0.7, (0.45, 0.1, 1.0), 1.0, 60),
        ),
        backdrop=(0.08, 0.04, 0.16),
    ),
    "underwater light": LightSetup(
        (0.1, 0.42, 0.52), (0.02, 0.1, 0.14), Sun(-30, 70, 0.25, (0.35, 0.9, 1.0), 6),
        saturation=0.7, fog=Fog((0.03, 0.27, 0.36), 1.0, 0.1, 0.2), backdrop=(0.1, 0.42, 0.52),
    ),
}  # fmt: skip
"""Lights by the names that `gsedit.words` gives them."""


def light_named(name: str) -> LightSetup:
    """The setup of a light's name. Raises UsageError for an unknown one."""
    if name not in LIGHTS:
        raise UsageError(f"there is no light {name!r}: choose one of {', '.join(LIGHTS)}")
    return LIGHTS[name]
