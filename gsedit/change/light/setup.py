"""Lights: sun, sky, lamps, fog, from the pictures' side; names: gsedit/words/looks/lights.txt.

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
from gsedit.words.names import TABLE, Row, light_of

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


def _setup(row: Row) -> LightSetup:
    """A row of the table, with its sun, lamps and fog."""
    kinds = {"sun": Sun, "lamp": Lamp, "fog": Fog}
    made = [(name, kinds[name](**values)) for name, values in row.parts]
    lamps = tuple(lamp for name, lamp in made if name == "lamp")
    others = {name: part for name, part in made if name != "lamp"}
    values = {key: value for key, value in row.values.items() if key not in ("time", "own")}
    return LightSetup(**values, **others, lamps=lamps)


LIGHTS = {name: _setup(row) for name, row in TABLE["lights"].items()}
"""Lights by the names that sentences give them."""
SKIES = {name: _setup(row) for name, row in TABLE["skies"].items()}
"""Lights that weathers bring, and no sentence names."""


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
