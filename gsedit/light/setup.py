"""Records of a light: sun, sky, lamps and fog, told from where the pictures are taken.

Angles are in degrees. An azimuth of 0 is light from the camera's side, 90 from its right, 180 from
behind the subject. Strengths are against the present picture: an open, level place gets 1 there.
Colors of light are linear and against white, colors of fog and sky as they are displayed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

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
