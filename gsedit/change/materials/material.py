"""Materials: how a surface reflects, its patterns; those of gsedit/words/looks/materials.txt
and what words name: "brushed copper with green patina", "matte", "polished granite".

Loads no torch.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from gsedit.words.colors import between, longest
from gsedit.words.names import TABLE, Row
from gsedit.words.scan import scanned

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
    """Base color as "#rrggbb", for a display: albedo, or reflectance of metal head on; "" for the
    colors that are there."""
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

    @property
    def is_plain(self) -> bool:
        """Whether it is one matte color, or those that are there: nothing of it is finer than a
        scene's Gaussians."""
        return not self.color or (self.is_matte and not self.layers)


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


def _layers(row: Row, clings: bool = False) -> tuple[Layer, ...]:
    """The layers of a row, or those that it clings in."""
    return tuple(
        Layer(name.removeprefix("clings "), **values)  # pyright: ignore[reportArgumentType]
        for name, values in row.parts
        if name.startswith("clings ") == clings
    )


_NAMED = {
    name: Material(**row.values, layers=_layers(row), clings=_layers(row, clings=True))
    for name, row in TABLE["materials"].items()
}
_WOODS = {
    name: recolored(_NAMED["wood"], row.values["color"]) for name, row in TABLE["timbers"].items()
}
MATERIALS: dict[str, Material] = _WOODS | _NAMED
"""All materials by name."""
OVERS = {name: _layers(row) for name, row in TABLE["overs"].items()}
"""Layers that a sentence can put on another material."""
COVERED = {word: name for name, row in TABLE["overs"].items() for word in row.words}
"""Such layers by the adjectives that name them: rusty iron, mossy stone."""
FINISHES: dict[str, dict[str, float]] = {
    name: row.values for name, row in TABLE["finishes"].items()
}
"""Parameters that a word for a finish sets."""
BRUSHED = Layer("grain", "#000000", 0.5, 0.02, 1.0, 0.5)
"""Streaks of brushed metal; their color is the metal's, darker."""
JOINED = re.compile(r"\b(?:with|and|covered in|under|overgrown with|flecked with)\b")
PAINT = Material("#808080", roughness=1.0, specular=0.0)
"""Paint of which nothing but the color is said: matte, all that it reflects is in its color."""


def paint_of(name: str, color: str) -> Material:
    """Paint in a color "#rrggbb", with the finish that its name says: "glossy red"."""
    material = replace(PAINT, color=color)
    for word in re.findall(r"[a-z]+", name.lower()):
        material = _finished(material, FINISHES.get(word, {}))
    return material if material.is_matte else replace(material, specular=USUAL_SPECULAR)


def material_of(name: str, color: str | None = None) -> Material | None:
    """The material of a name, in another base color if one is given as "#rrggbb"; None where the
    name says neither a material nor a finish."""
    main, *others = JOINED.split(name.lower().replace("-", " "))
    words = re.findall(r"[a-z]+", main)
    plain = reversed(scanned(main.split(" with ")[0]))
    found = next((word.value for word in plain if word.kind in ("material", "look")), "")
    finish = [word for word in words if word in FINISHES]
    if found not in MATERIALS and not finish and color is None:
        return None
    material = MATERIALS.get(found) or replace(PAINT, color="")
    if color is not None:
        material = recolored(material, color)
    for word in finish:
        material = _finished(material, FINISHES[word])
    if "brushed" in finish and material.metalness > 0 and material.color:
        streaks = replace(BRUSHED, color=darker(material.color))
        material = replace(material, layers=(streaks, *material.layers))

    before = [COVERED[word] for word in words if word in COVERED and found != COVERED[word]]
    layers = _overs([*others, *before], found)
    return replace(material, layers=(*material.layers, *layers))


def _overs(texts: list[str], known: str) -> list[Layer]:
    """Layers that the texts put on a material, in a color if one is said."""
    found: list[Layer] = []
    for text in texts:
        words = re.findall(r"[a-z]+", text)
        name = next((word for word in words if word in OVERS), None)
        if name is None or name == known:
            continue
        at = words.index(name)
        said = longest(words[max(0, at - 2) : at]) if at else None
        layers = OVERS[name]
        for each in layers:  # a quarter of the way: green patina is not as green as paint
            toned = between(each.color, between(each.color, said[1])) if said else each.color
            found.append(replace(each, color=toned))
    return found


def _finished(material: Material, changes: dict[str, float]) -> Material:
    """The material with a finish; its patterns are at most as rough where it is smoothed."""
    roughness = changes.get("roughness", material.roughness)
    smoother = roughness < material.roughness
    layers = tuple(
        replace(each, roughness=min(each.roughness, roughness) if smoother else each.roughness)
        for each in material.layers
    )
    coat = changes.get("coat", material.coat)
    if material.metalness:  # metals are polished, not varnished
        coat = min(coat, material.coat)
    kept = {**changes, "coat": coat}
    return replace(material, **kept, layers=layers)
