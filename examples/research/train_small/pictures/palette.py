"""Random materials: of grounds, walls and plants, of subjects, and of all that a scene needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.colors import ramp
from research.train_small.pictures.materials import Material
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.textures import Textures

Maker: TypeAlias = Callable[[RandomStream, Textures], Material]

# A scene's materials by number: 0, 1 and 2 are the subject's, from BACKDROP on the backdrops'.
GROUND, PATCH, ROCK, FOLIAGE, TRUNK, BACKDROP = 3, 4, 5, 6, 7, 8


def _material(
    rng: RandomStream,
    textures: Textures,
    families: tuple[str, str],
    colors: Float[Tensor, "c 3"],
    repeats: float,
    **fixed: float,
) -> Material:
    """A material whose other traits are random, save the `fixed` ones."""
    return Material(
        textures=(textures.pick(families[0], rng), textures.pick(families[1], rng)),
        share=rng(0.2, 0.6),
        repeats=(repeats, repeats * rng(0.3, 2.0)),
        ramp=colors,
        drift_texture=textures.pick("cloud", rng),
        drift=rng(0.1, 0.6),
        specular=0.0,
        shininess=10.0,
        bump=rng(0.1, 0.5),
    )._replace(**fixed)


def grass(rng: RandomStream, textures: Textures) -> Material:
    """Grass, moss, low plants."""
    hue, saturation, values = rng(0.19, 0.35), rng(0.3, 0.75), (rng(0.05, 0.3), rng(0.5, 0.9))
    colors = ramp(rng, hue, saturation, values, 0.04)
    families = (rng.pick(("blades", "leaves")), "rough")
    return _material(rng, textures, families, colors, rng(0.4, 2.0))


def soil(rng: RandomStream, textures: Textures) -> Material:
    """Earth, sand, bark chips, dry leaves."""
    hue, saturation, values = rng(0.02, 0.14), rng(0.1, 0.55), (rng(0.1, 0.35), rng(0.4, 0.9))
    colors = ramp(rng, hue, saturation, values)
    families = (rng.pick(("cells", "leaves", "rough", "speckle")), rng.pick(("rough", "blades")))
    return _material(rng, textures, families, colors, rng(0.5, 2.0))


def stone(rng: RandomStream, textures: Textures) -> Material:
    """Asphalt, gravel, concrete, rock."""
    hue, saturation, values = rng(), rng(0.0, 0.15), (rng(0.1, 0.5), rng(0.5, 0.95))
    colors = ramp(rng, hue, saturation, values, 0.1)
    first = rng.pick(("speckle", "cells", "cracks", "rough"))
    families = (first, rng.pick(("rough", "cloud", "cracks")))
    return _material(rng, textures, families, colors, rng(0.3, 2.0), specular=rng(0, 0.15))


def laid(rng: RandomStream, textures: Textures) -> Material:
    """Tiles, planks, bricks, carpets."""
    hue = rng(0.0, 0.15) if rng.chance(0.7) else rng()
    colors = ramp(rng, hue, rng(0.0, 0.6), (rng(0.1, 0.4), rng(0.5, 0.95)))
    first = rng.pick(("masonry", "masonry", "wood", "print"))
    families = (first, rng.pick(("rough", "wood", "cloud")))
    repeats, fixed = rng(0.2, 0.8), {"share": rng(0.1, 0.4), "specular": rng(0, 0.4)}
    return _material(rng, textures, families, colors, repeats, **fixed)


def smooth(rng: RandomStream, textures: Textures) -> Material:
    """Paint, paper, plaster, a studio's backdrop."""
    value = rng(0.15, 0.97)
    colors = ramp(rng, rng(), rng() ** 2 * 0.9, (value - 0.03, value + 0.03))
    repeats, fixed = rng(0.2, 0.6), {"drift": rng(0, 0.2), "bump": 0.0, "specular": rng(0, 0.3)}
    return _material(rng, textures, ("cloud", "rough"), colors, repeats, **fixed)


def foliage(rng: RandomStream, textures: Textures) -> Material:
    """Leaves of trees and bushes, from near or from far."""
    hue, saturation = rng(0.15, 0.4), rng(0.2, 0.7)
    colors = ramp(rng, hue, saturation, (rng(0.02, 0.12), rng(0.35, 0.85)), 0.05)
    families = (rng.pick(("leaves", "leaves", "rough", "blades")), "rough")
    return _material(rng, textures, families, colors, rng(0.2, 1.0), drift=rng(0.3, 0.9))


def bark(rng: RandomStream, textures: Textures) -> Material:
    """Trunks, and woods seen from far."""
    hue, saturation, values = rng(0.02, 0.1), rng(0.1, 0.5), (rng(0.03, 0.15), rng(0.3, 0.6))
    colors = ramp(rng, hue, saturation, values)
    return _material(rng, textures, ("cracks", "blades"), colors, rng(0.5, 1.5), drift=0.6)


GROUNDS: tuple[Maker, ...] = (grass, grass, soil, soil, stone, stone, laid)
STUDIO_FLOORS: tuple[Maker, ...] = (smooth, smooth, laid)
WALLS: tuple[Maker, ...] = (laid, smooth, stone)
VEGETATION: tuple[Maker, ...] = (foliage, foliage, foliage, bark, grass)


def anything(rng: RandomStream, textures: Textures) -> Material:
    """A subject's material: any colors, any pattern."""
    style = rng.integer(0, 9)
    specular, shininess = rng() ** 2, 2 ** rng(2, 7)
    if style <= 3:
        material = _mineral(rng, textures)._replace(specular=0.5 * specular)
    elif style <= 6:
        material = _painted(rng, textures)._replace(specular=specular)
    elif style <= 8:
        material = _patterned(rng, textures)._replace(specular=specular)
    else:
        return rng.pick((grass, foliage, bark, soil))(rng, textures)
    return material._replace(shininess=shininess)


def _mineral(rng: RandomStream, textures: Textures) -> Material:
    """Stone and metal: grey or one hue, speckled."""
    colors = ramp(rng, rng(), rng() ** 2 * 0.6, (rng(0.1, 0.6), rng(0.45, 0.95)))
    first = rng.pick(("speckle", "rough", "cracks", "cells"))
    families = (first, rng.pick(("cloud", "rough", "speckle")))
    return _material(rng, textures, families, colors, rng(0.4, 2.5))


def _painted(rng: RandomStream, textures: Textures) -> Material:
    """One color, nearly plain."""
    value = rng(0.2, 0.95)
    colors = ramp(rng, rng(), rng(0, 1), (value - rng(0, 0.15), value + rng(0, 0.1)))
    repeats, fixed = rng(0.3, 1.5), {"drift": rng(0, 0.3), "bump": rng(0, 0.2)}
    return _material(rng, textures, ("cloud", "rough"), colors, repeats, **fixed)


def _patterned(rng: RandomStream, textures: Textures) -> Material:
    """Two colors in a pattern."""
    values = (rng(0.1, 0.9), rng(0.1, 0.9))
    dark, light = (ramp(rng, rng(), rng(0, 1), (value, value + 0.1)) for value in values)
    colors = torch.cat((dark[:3], light[2:]))
    families = (rng.pick(("print", "print", "masonry", "cloud", "cells", "wood")), "rough")
    repeats, share = rng(0.3, 1.5), rng(0, 0.2)
    return _material(rng, textures, families, colors, repeats, share=share, bump=0.0)


def random_materials(rng: RandomStream, textures: Textures, studio: bool) -> list[Material]:
    """All of a scene's materials but those of its backdrops, by number."""
    grounds = STUDIO_FLOORS if studio else GROUNDS
    main, *details = (anything(rng, textures) for _ in range(3))
    around = [rng.pick(grounds)(rng, textures) for _ in (GROUND, PATCH)]
    around += [stone(rng, textures), foliage(rng, textures), bark(rng, textures)]
    if rng.chance(0.25):  # all of one make
        details = [main, main]
    if rng.chance(0.15):  # the subject in the colors of what is around it
        main = main._replace(ramp=rng.pick(around[:4]).ramp)
    return [main, *details, *around]
