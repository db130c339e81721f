"""Materials: how a surface reflects and the patterns in it; the table of those with a name; and
the one that words name: "brushed copper with green patina", "matte", "polished granite".

Loads no torch.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from gsedit.words.colors import between, longest
from gsedit.words.direct import material_of as canonical

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

    @property
    def is_plain(self) -> bool:
        """Whether it is one matte color: nothing of it is finer than a scene's Gaussians."""
        return self.is_matte and not self.layers


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


def _metal(color: str, roughness: float = 0.3, *layers: Layer) -> Material:
    return Material(color, metalness=1.0, roughness=roughness, layers=layers)


def _stone(color: str, roughness: float = 0.85, *layers: Layer, coat: float = 0.0) -> Material:
    return Material(color, roughness=roughness, layers=layers, coat=coat)


def _gem(color: str, translucency: float = 0.5, *layers: Layer) -> Material:
    return Material(color, roughness=0.25, coat=0.6, translucency=translucency, layers=layers)


def _glass(color: str, transmission: float, roughness: float = 0.1) -> Material:
    return Material(color, roughness=roughness, coat=1.0, transmission=transmission)


def _soft(color: str, translucency: float = 0.3, *layers: Layer) -> Material:
    return Material(color, roughness=0.8, translucency=translucency, layers=layers)


_VERDIGRIS = Layer("crevices", "#6fae9c", share=0.4, scale=0.15)
_RUST = (
    Layer("patches", "#7a3d1c", share=0.88, scale=0.25, roughness=0.95),
    Layer("patches", "#a5562a", share=0.4, scale=0.1, roughness=0.95),
    Layer("specks", "#b9682f", share=0.3, scale=0.02, roughness=0.95),
    Layer("patches", "#4a2413", share=0.2, scale=0.06, roughness=0.95),
)

METALS = {
    "gold": _metal("#ffc65a", 0.2),
    "silver": _metal("#f4f3f0", 0.2),
    "bronze": _metal("#a67a48", 0.22, Layer("crevices", "#2a2014", 0.35, 0.2, 0.8, 0.4)),
    "copper": _metal("#f2a07e", 0.28),
    "brass": _metal("#e6c878", 0.28),
    "iron": _metal("#8f8d8b", 0.55, Layer("patches", "#5f5c59", 0.4, 0.15, 0.9, 0.7)),
    "steel": _metal("#b4b8bc", 0.3),
    "aluminum": _metal("#dfe2e4", 0.35),
    "chrome": _metal("#dfe3e6", 0.06),
    "titanium": _metal("#b7b0a8", 0.38),
    "lead": _metal("#85888d", 0.65),
    "tin": _metal("#c3c4c8", 0.45),
    "pewter": _metal("#a5a7a9", 0.5),
    "platinum": _metal("#e6e2da", 0.2),
    "metal": _metal("#b4b8bc", 0.32),
    "nickel": _metal("#cfc6b6", 0.25),
    "mercury": _metal("#e2e5e9", 0.04),
    "gunmetal": _metal("#6b7177", 0.35),
    "verdigris": _metal(
        "#9a6440", 0.45, Layer("patches", "#6fae9c", 0.7, 0.3), _VERDIGRIS,
        Layer("specks", "#8fc9b6", 0.25, 0.08),
    ),
    "rust": _metal("#77716d", 0.6, *_RUST),
}  # fmt: skip
STONES = {
    "marble": Material(
        "#f1efeb", roughness=0.35, coat=0.5, translucency=0.25,
        layers=(
            Layer("patches", "#dcdad6", 0.3, 0.6, roughness=0.35),
            Layer("veins", "#6f7076", 0.08, 0.5, roughness=0.35),
        ),
    ),
    "granite": _stone(
        "#99958f", 0.8, Layer("specks", "#cbc7c2", 0.35, 0.014),
        Layer("specks", "#a08b83", 0.08, 0.016), Layer("specks", "#3c3939", 0.16, 0.012),
    ),
    "sandstone": _stone(
        "#d0ab77", 0.95, Layer("strata", "#b98a58", 0.4, 0.12),
        Layer("specks", "#e0c294", 0.3, 0.03)
    ),
    "limestone": _stone("#d6cebb", 0.95, Layer("patches", "#bfb49c", 0.3, 0.3)),
    "slate": _stone("#4f5860", 0.75, Layer("strata", "#3c444c", 0.45, 0.06)),
    "stone": _stone(
        "#8f8b84", 0.95, Layer("patches", "#77736c", 0.4, 0.3),
        Layer("specks", "#a8a49c", 0.3, 0.04)
    ),
    "concrete": _stone("#a3a19c", 0.95, Layer("patches", "#8f8d88", 0.35, 0.25)),
    "brick": _stone(
        "#9c4a34", 0.95, Layer("patches", "#7f3a2a", 0.4, 0.3),
        Layer("bricks", "#c9c0b2", 0.2, 0.12)
    ),
    "basalt": _stone("#434446", 0.85, Layer("specks", "#2f3032", 0.4, 0.04)),
    "obsidian": Material("#0d0c10", roughness=0.1, coat=1.0),
    "onyx": Material(
        "#17161a", roughness=0.15, coat=1.0, layers=(
        Layer("strata", "#5b4a3c", 0.15, 0.12, 0.0, 0.2),)
    ),
    "alabaster": _soft("#f3ebdf", 0.5, Layer("veins", "#d9c6a8", 0.12, 0.6)),
    "quartz": _glass("#f0e9ec", 0.35, 0.25),
    "plaster": _stone("#ebe7df", 1.0),
    "clay": _stone("#b0714e", 0.95, Layer("patches", "#9c6040", 0.3, 0.3)),
    "terracotta": _stone("#c8643c", 0.95, Layer("patches", "#b3542f", 0.35, 0.3)),
    "porcelain": Material("#f6f4f0", roughness=0.3, coat=1.0, translucency=0.15),
    "ceramic": Material("#e6e0d6", roughness=0.4, coat=0.9),
    "lapis lazuli": _stone(
        "#1f4f9c", 0.35, Layer("patches", "#16357a", 0.4, 0.25, 0.0, 0.35),
        Layer("specks", "#d8b860", 0.06, 0.06, 1.0, 0.35), coat=0.6,
    ),
    "malachite": Material(
        "#0b8a5c", roughness=0.3, coat=0.7, layers=(
        Layer("rings", "#0a5038", 0.45, 0.12, 0.0, 0.3),)
    ),
    "coal": _stone("#1f1f21", 0.6, Layer("specks", "#38383b", 0.2, 0.06, 0.3, 0.35)),
    "turquoise": Material(
        "#36b5aa", roughness=0.35, coat=0.5, layers=(
        Layer("veins", "#4a3a2c", 0.07, 0.35, 0.0, 0.5),)
    ),
    "coral": _soft("#f0705c", 0.25, Layer("specks", "#f6a08e", 0.3, 0.05)),
    "lava": Material(
        "#1d1614", roughness=0.95, layers=(Layer("veins", "#ff5a14", 0.22, 0.4, 0.0, 0.9, 1.6),)
    ),
}  # fmt: skip
GEMS = {
    "jade": _gem("#4aa277", 0.6, Layer("patches", "#2f7f58", 0.35, 0.4, 0.0, 0.25),
                 Layer("veins", "#8fcfa4", 0.06, 0.5, 0.0, 0.25)),
    "amethyst": _gem("#8a5fc0", 0.5, Layer("patches", "#6a3fa8", 0.4, 0.35, 0.0, 0.25)),
    "ruby": _gem("#b3122c", 0.5),
    "emerald": _gem("#178a54", 0.5, Layer("veins", "#0c6038", 0.12, 0.4, 0.0, 0.25)),
    "sapphire": _gem("#1f3f9e", 0.5),
    "amber": _gem("#d98c1e", 0.7, Layer("specks", "#a8600f", 0.1, 0.08, 0.0, 0.25)),
    "opal": _gem("#dbe6e8", 0.5, Layer("patches", "#f0c4d6", 0.25, 0.25, 0.0, 0.25),
                 Layer("patches", "#a4dcd6", 0.25, 0.18, 0.0, 0.25)),
    "pearl": Material("#efe9df", metalness=0.25, roughness=0.3, coat=0.7, translucency=0.2),
    "diamond": _glass("#f4fafd", 0.75, 0.02),
    "crystal": _glass("#eef6fa", 0.65, 0.04),
    "glass": _glass("#dbe9e6", 0.7, 0.06),
    "ice": Material(
        "#cfe8f2", roughness=0.3, coat=0.9, translucency=0.4, transmission=0.35,
        layers=(Layer("veins", "#f4fafd", 0.15, 0.4, 0.0, 0.5),),
    ),
}  # fmt: skip
GROWN = {
    "wood": Material("#9a683c", roughness=0.7, coat=0.15, layers=(
        Layer("rings", "#5c3216", 0.4, 0.17, 0.0, 0.75), Layer("grain", "#5c3719", 0.25, 0.035))),
    "bamboo": Material("#cdb372", roughness=0.6, coat=0.3,
                       layers=(Layer("grain", "#b3954f", 0.4, 0.03, 0.0, 0.6),)),
    "cork": _stone("#b58a5c", 1.0, Layer("specks", "#8a623a", 0.3, 0.05)),
    "leather": Material("#6e4428", roughness=0.6, coat=0.25,
                        layers=(Layer("specks", "#573319", 0.4, 0.04, 0.0, 0.7),)),
    "ivory": Material("#f2ead2", roughness=0.45, coat=0.4, translucency=0.25,
                      layers=(Layer("grain", "#e3d5b0", 0.3, 0.05, 0.0, 0.45),)),
    "bone": _soft("#e3dac6", 0.15, Layer("patches", "#cdbf9f", 0.3, 0.3)),
    "moss": Material("#5d7a33", roughness=1.0,
                     layers=(Layer("patches", "#6f8a3a", 0.4, 0.15),
                             Layer("specks", "#8ba54e", 0.35, 0.02),
                             Layer("specks", "#35491d", 0.35, 0.025)),
                     clings=(Layer("up", "#5d7a33", 0.5, 0.18),
                             Layer("crevices", "#5d7a33", 0.12, 0.1))),
    "straw": _stone("#d8bf72", 1.0, Layer("grain", "#a88c42", 0.4, 0.03)),
    "wool": _stone("#e6dfd0", 1.0, Layer("weave", "#cfc5b0", 0.4, 0.035)),
    "flesh": _soft("#d9a58a", 0.35),
}  # fmt: skip
MADE = {
    "rubber": _stone("#2c2c2d", 0.8),
    "plastic": Material("#d0d0cf", roughness=0.35, coat=0.5),
    "carbon fiber": Material("#1c1d20", metalness=0.4, roughness=0.35, coat=1.0,
                             layers=(Layer("weave", "#3c3f45", 0.5, 0.03, 0.6, 0.35),)),
    "wax": _soft("#efe2b8", 0.6),
    "soap": Material("#ece8d8", roughness=0.5, coat=0.3, translucency=0.5),
    "candy": Material("#f0629a", roughness=0.3, coat=0.9, translucency=0.3,
                      layers=(Layer("strata", "#fbeef3", 0.4, 0.2, 0.0, 0.3),)),
    "jelly": Material("#d8345a", roughness=0.15, coat=1.0, translucency=0.7, transmission=0.3),
    "paper": _stone("#f2efe6", 1.0),
    "cardboard": _stone("#b3895b", 1.0, Layer("grain", "#a07848", 0.4, 0.03)),
    "velvet": _stone("#6a1b34", 1.0),
    "felt": _stone("#8b8f94", 1.0, Layer("specks", "#7c8085", 0.4, 0.03)),
    "denim": _stone("#3f5f8a", 1.0, Layer("weave", "#6a86ab", 0.4, 0.025)),
    "fabric": _stone("#b9ae9c", 1.0, Layer("weave", "#a2967f", 0.4, 0.03)),
    "foam": _stone("#f0efea", 1.0),
}  # fmt: skip
FOOD = {
    "chocolate": Material("#4f2c1a", roughness=0.5, coat=0.3, translucency=0.1),
    "cheese": _soft("#f2c14e", 0.3, Layer("patches", "#d99f2c", 0.12, 0.12)),
    "gingerbread": _stone("#a5652e", 0.95, Layer("specks", "#86501f", 0.3, 0.05)),
    "sugar": _soft("#f6f3ee", 0.3, Layer("specks", "#ffffff", 0.3, 0.02)),
    "butter": _soft("#f6e08a", 0.4),
    "bread": _stone("#c48a4c", 1.0, Layer("up", "#8f5a28", 0.45, 0.3)),
}
EARTH = {
    "sand": _stone("#d6bd8c", 1.0, Layer("specks", "#bb9f6c", 0.4, 0.025)),
    "snow": _soft("#f4f8fb", 0.3),
    "mud": _stone("#5f4630", 0.7, Layer("patches", "#463220", 0.4, 0.3, 0.0, 0.6)),
}
LIT = {
    "glow": Material(
        "#ffd84a", roughness=1.0, glow=1.2, layers=(
        Layer("crevices", "#ff9a1e", 0.35, 0.2, 0.0, 1.0, 0.9),)
    ),
}  # fmt: skip
"""Materials that send light, less and deeper in hollows, or their shape would not show."""
TIMBERS = {
    "oak": "#b08954", "walnut": "#6a4a38", "pine": "#d9b382", "mahogany": "#6e2c18",
    "teak": "#a0703c", "ebony": "#332720", "birch": "#d8c3a0", "cherry wood": "#7a3b22",
    "cedar": "#a0603c", "maple": "#d2a66f",
}  # fmt: skip
"""Woods that are as wood is, in another color."""
WOODS = {name: recolored(GROWN["wood"], color) for name, color in TIMBERS.items()}
MATERIALS: dict[str, Material] = WOODS | METALS | STONES | GEMS | GROWN | MADE | FOOD | EARTH | LIT
"""All materials by name."""
OVERS: dict[str, tuple[Layer, ...]] = {
    "patina": (_VERDIGRIS, Layer("patches", "#7ab8a4", 0.3, 0.3)),
    "verdigris": (_VERDIGRIS, Layer("patches", "#7ab8a4", 0.3, 0.3)),
    "rust": (Layer("patches", "#7a3d1c", 0.4, 0.25, 0.0, 0.95),
             Layer("specks", "#b5632a", 0.15, 0.06, 0.0, 0.95)),
    "moss": (Layer("up", "#4c6a2a", 0.45, 0.18, 0.0, 1.0),
    Layer("crevices", "#3a5220", 0.2, 0.1, 0.0, 1.0)),
    "snow": (Layer("up", "#f4f8fb", 0.4, 0.3, 0.0, 0.95),),
    "dust": (Layer("up", "#b5aa98", 0.5, 0.25, 0.0, 1.0),),
    "dirt": (Layer("crevices", "#4a3a28", 0.35, 0.15, 0.0, 1.0),
             Layer("patches", "#5f4a33", 0.2, 0.3, 0.0, 1.0)),
    "veins": (Layer("veins", "#5a5a5e", 0.12, 0.5, 0.0, 0.3),),
}  # fmt: skip
"""Layers that a sentence can put on another material."""


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
