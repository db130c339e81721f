"""The material that words name: "brushed copper with green patina", "matte", "polished granite".

Loads no torch.
"""

from __future__ import annotations

import re
from dataclasses import replace

from gsedit.change.materials.table import (
    MATERIALS,
    OVERS,
    USUAL_SPECULAR,
    Layer,
    Material,
    darker,
    recolored,
)
from gsedit.words.colors import between, longest
from gsedit.words.direct import material_of as canonical

FINISHES: dict[str, dict[str, float]] = {
    "matte": {"roughness": 1.0, "coat": 0.0},
    "flat": {"roughness": 1.0, "coat": 0.0},
    "matt": {"roughness": 1.0, "coat": 0.0},
    "rough": {"roughness": 0.9, "coat": 0.0},
    "weathered": {"roughness": 0.85, "coat": 0.0},
    "satin": {"roughness": 0.45},
    "brushed": {"roughness": 0.42},
    "polished": {"roughness": 0.12, "coat": 0.8},
    "shiny": {"roughness": 0.15, "coat": 0.8},
    "glossy": {"roughness": 0.3, "coat": 1.0},
    "lacquered": {"roughness": 0.3, "coat": 1.0},
    "glazed": {"roughness": 0.3, "coat": 1.0},
    "varnished": {"roughness": 0.4, "coat": 0.8},
    "mirror": {"roughness": 0.04},
    "metallic": {"metalness": 1.0, "roughness": 0.35},
    "translucent": {"translucency": 0.7},
    "frosted": {"roughness": 0.6, "coat": 0.0},
    "glowing": {"glow": MATERIALS["glow"].glow},
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
    found = canonical(main)
    finish = [word for word in words if word in FINISHES]
    if found not in MATERIALS and not finish and color is None:
        return None
    material = MATERIALS.get(found, PAINT)
    if color is not None:
        material = recolored(material, color)
    for word in finish:
        material = _finished(material, FINISHES[word])
    if "brushed" in finish and material.metalness > 0:
        streaks = replace(BRUSHED, color=darker(material.color))
        material = replace(material, layers=(streaks, *material.layers))

    layers = _overs([*others, *_before(words, found)], found)
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
        found += (
            [replace(each, color=_toned(each.color, said[1])) for each in layers]
            if said
            else list(layers)
        )
    return found


def _before(words: list[str], found: str) -> list[str]:
    """The layers that adjectives name: rusty iron, mossy stone, snowy, dusty."""
    adjectives = {"rusty": "rust", "mossy": "moss", "snowy": "snow", "dusty": "dust",
                  "dirty": "dirt", "veined": "veins", "patinated": "patina"}  # fmt: skip
    return [adjectives[word] for word in words if word in adjectives and found != adjectives[word]]


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


def _toned(own: str, said: str) -> str:
    """A layer's color, a quarter of the way to the one that is said: green patina is not as green
    as paint."""
    return between(own, between(own, said))
