"""A material: how a surface reflects, and the patterns in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

PatternName = Literal[
    "veins", "rings", "grain", "specks", "patches", "strata", "weave", "bricks", "crevices", "up"
]


USUAL_SPECULAR = 0.04
"""Reflectance head on of stone, wood, lacquer: an index of refraction of 1.5."""


@dataclass(frozen=True)
class Layer:
    """Something on or in a material, where a pattern in space says."""

    pattern: PatternName
    """crevices: in hollows and carved lines; up: on what faces up; the others are in space."""
    color: str
    """Base color as "#rrggbb", for a display."""
    share: float = 0.5
    """Share of the surface that it is about on, in [0, 1]."""
    scale: float = 0.2
    """Size of the pattern's features, in radii of the subject."""
    metalness: float = 0.0
    roughness: float = 0.8
    glow: float = 0.0


@dataclass(frozen=True)
class Material:
    """Parameters of a surface; each but the colors is in [0, 1]."""

    color: str
    """Base color as "#rrggbb", for a display: albedo, or reflectance of metal head on."""
    metalness: float = 0.0
    roughness: float = 0.6
    """0 is a mirror, 1 is chalk."""
    coat: float = 0.0
    """Share of a clear, smooth coat over it: lacquer or glaze."""
    translucency: float = 0.0
    """Share of the light that has gone through the body: softer, and deeper in color."""
    transmission: float = 0.0
    """Share of what comes through from behind, as in glass, against the base color."""
    glow: float = 0.0
    """Light that it sends out itself, against white; it may be above 1."""
    specular: float = USUAL_SPECULAR
    """Reflectance head on of what is no metal."""
    layers: tuple[Layer, ...] = ()
    """Patterns, the uppermost last."""
    clings: tuple[Layer, ...] = ()
    """Patterns that it is in, where it is not everywhere: the old surface shows between them."""

    @property
    def is_matte(self) -> bool:
        """Whether its color is about the same from every direction."""
        shiny = [self.metalness, self.coat, self.transmission]
        rough = min([self.roughness, *(layer.roughness for layer in self.layers)])
        shiny += [layer.metalness for layer in self.layers]
        return max(shiny) == 0 and rough >= MATTE


MATTE = 0.75
"""Roughness from which reflections of a surface without metal are not seen."""


def recolored(material: Material, color: str) -> Material:
    """The material in another base color; its patterns are as much lighter or darker than that as
    they were than its own."""
    layers = [
        replace(layer, color=_moved(layer.color, material.color, color))
        for layer in material.layers
    ]
    return replace(material, color=color, layers=tuple(layers))


def darker(color: str) -> str:
    """Return the color of a fold or streak in a surface of another color."""
    return "#" + "".join(f"{int(0.82 * each):02x}" for each in _channels(color))


def _channels(color: str) -> list[int]:
    return [int(color[at : at + 2], 16) for at in (1, 3, 5)]


def _moved(layer: str, before: str, after: str) -> str:
    """A layer's color, as far from a new base color as it was from the old one."""
    parts = zip(_channels(layer), _channels(before), _channels(after))
    return "#" + "".join(f"{min(255, max(0, new + old - base)):02x}" for old, base, new in parts)
