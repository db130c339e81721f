"""Lights: sun, sky, lamps and fog, told from where the pictures are taken; those with a name.

Angles are in degrees. An azimuth of 0 is light from the camera's side, 90 from its right, 180 from
behind the subject. Strengths are against the present picture: an open, level place gets 1 there.
Colors of light are linear and against white, colors of fog and sky as they are displayed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.scene.color_space import linear_of_srgb
from gsedit.words.direct import light_of

Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)
LEAST, MOST = -1.0, 2.0
"""Signed share by which a light can be changed."""
BRIGHTEST_DEEP = 4.0
"""Largest factor of the light of what is deep, where none of it is asked for."""


@dataclass(frozen=True)
class Sun:
    """Parallel light from far away."""

    azimuth: float
    elevation: float
    """Angle above the ground."""
    strength: float
    """Light that it gives to what faces it."""
    color: Rgb = WHITE
    blur: float = 2.0
    """Half the angle that it fills: a larger one has softer shadows."""


@dataclass(frozen=True)
class Lamp:
    """A spot of light that points at the subject; it fades with the square of the distance."""

    azimuth: float
    elevation: float
    strength: float
    """Light that it gives to what faces it at the subject's center."""
    color: Rgb = WHITE
    distance: float = 0.8
    """From the subject's center, in the cameras' distance from it."""
    cone: float = 50.0
    """Half the angle of its cone, at most 60: light ends there, softly."""


@dataclass(frozen=True)
class Fog:
    """Haze that hides what is far from the subject."""

    color: Rgb
    """Display color of what it hides."""
    density: float
    """Share of an e-fold over the cameras' distance from the subject."""
    start: float = 0.3
    """Distance from the subject at which it begins, in the cameras' distance."""
    base: float = 0.1
    """Share of it before the subject."""


@dataclass(frozen=True)
class LightSetup:
    """All light of a scene."""

    sky: Rgb
    """Light of an open sky on a level place."""
    ground: Rgb
    """Light from below on what faces down."""
    sun: Sun | None = None
    lamps: tuple[Lamp, ...] = ()
    fog: Fog | None = None
    saturation: float = 1.0
    """Factor of the saturation: eyes see little color at night."""
    backdrop: Rgb | None = None
    """Display color of a bright sky; None: it is toned as what is far away."""

    deep: bool = False
    """Whether more of it is darker, as of a night."""

    def turned(self, azimuth: float | None, elevation: float | None) -> LightSetup:
        """The setup with its main light (the sun, else the first lamp) from another side."""
        change = {"azimuth": azimuth, "elevation": elevation}
        change = {name: value for name, value in change.items() if value is not None}
        if self.sun is not None:
            return replace(self, sun=replace(self.sun, **change))
        if self.lamps:
            return replace(self, lamps=(replace(self.lamps[0], **change), *self.lamps[1:]))
        return self

    def scaled(self, factor: float) -> LightSetup:
        """The setup with all its light times a factor; with fog, only that as dense; the deeper the
        darker."""
        if self.deep:
            factor = 1 / max(factor, 1 / BRIGHTEST_DEEP)
        if self.fog is not None:
            fog = self.fog
            base = 1 - (1 - fog.base) ** factor
            return replace(self, fog=replace(fog, density=fog.density * factor, base=base))
        return replace(
            self,
            sky=_times(self.sky, factor),
            ground=_times(self.ground, factor),
            sun=self.sun and replace(self.sun, strength=self.sun.strength * factor),
            lamps=tuple(replace(lamp, strength=lamp.strength * factor) for lamp in self.lamps),
        )

    def colored(self, linear: Float64[np.ndarray, "3"]) -> LightSetup:
        """The setup with its main light, or else its fog or sky, in a color of full strength."""
        red, green, blue = (linear / max(float(linear.max()), 1e-6)).tolist()
        color = (red, green, blue)
        if self.sun is not None:
            return replace(self, sun=replace(self.sun, color=color))
        if self.lamps:
            return replace(self, lamps=(replace(self.lamps[0], color=color), *self.lamps[1:]))
        if self.fog is not None:
            return replace(self, fog=replace(self.fog, color=color))
        return replace(self, sky=_product(self.sky, color))


def _times(color: Rgb, factor: float) -> Rgb:
    return _product(color, (factor, factor, factor))


def _product(first: Rgb, second: Rgb) -> Rgb:
    return first[0] * second[0], first[1] * second[1], first[2] * second[2]


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
"""Azimuth and elevation, degrees, by the words that say them; None: as the light has it.
The first that is found counts."""


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
