"""Random materials: of grounds, walls and plants, of subjects, and of all that a scene needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from train_small.pictures.colors import ramp
from train_small.pictures.materials import Material
from train_small.pictures.randomness import Dice
from train_small.pictures.textures import Textures

Maker: TypeAlias = Callable[[Dice, Textures], Material]

# A scene's materials by number: 0, 1 and 2 are the subject's, from BACKDROP on the backdrops'.
GROUND, PATCH, ROCK, FOLIAGE, TRUNK, BACKDROP = 3, 4, 5, 6, 7, 8


def _material(
    dice: Dice,
    textures: Textures,
    families: tuple[str, str],
    colors: Float[Tensor, "c 3"],
    repeats: float,
    **fixed: float,
) -> Material:
    """A material whose other traits are random, save the `fixed` ones."""
    return Material(
        textures=(textures.pick(families[0], dice), textures.pick(families[1], dice)),
        share=dice(0.2, 0.6),
        repeats=(repeats, repeats * dice(0.3, 2.0)),
        ramp=colors,
        drift_texture=textures.pick("cloud", dice),
        drift=dice(0.1, 0.6),
        specular=0.0,
        shininess=10.0,
        bump=dice(0.1, 0.5),
    )._replace(**fixed)


def grass(dice: Dice, textures: Textures) -> Material:
    """Grass, moss, low plants."""
    hue, saturation, values = dice(0.19, 0.35), dice(0.3, 0.75), (dice(0.05, 0.3), dice(0.5, 0.9))
    colors = ramp(dice, hue, saturation, values, 0.04)
    families = (dice.pick(("blades", "leaves")), "rough")
    return _material(dice, textures, families, colors, dice(0.4, 2.0))


def soil(dice: Dice, textures: Textures) -> Material:
    """Earth, sand, bark chips, dry leaves."""
    hue, saturation, values = dice(0.02, 0.14), dice(0.1, 0.55), (dice(0.1, 0.35), dice(0.4, 0.9))
    colors = ramp(dice, hue, saturation, values)
    families = (dice.pick(("cells", "leaves", "rough", "speckle")), dice.pick(("rough", "blades")))
    return _material(dice, textures, families, colors, dice(0.5, 2.0))


def stone(dice: Dice, textures: Textures) -> Material:
    """Asphalt, gravel, concrete, rock."""
    hue, saturation, values = dice(), dice(0.0, 0.15), (dice(0.1, 0.5), dice(0.5, 0.95))
    colors = ramp(dice, hue, saturation, values, 0.1)
    first = dice.pick(("speckle", "cells", "cracks", "rough"))
    families = (first, dice.pick(("rough", "cloud", "cracks")))
    return _material(dice, textures, families, colors, dice(0.3, 2.0), specular=dice(0, 0.15))


def laid(dice: Dice, textures: Textures) -> Material:
    """Tiles, planks, bricks, carpets."""
    hue = dice(0.0, 0.15) if dice.chance(0.7) else dice()
    colors = ramp(dice, hue, dice(0.0, 0.6), (dice(0.1, 0.4), dice(0.5, 0.95)))
    first = dice.pick(("masonry", "masonry", "wood", "print"))
    families = (first, dice.pick(("rough", "wood", "cloud")))
    repeats, fixed = dice(0.2, 0.8), {"share": dice(0.1, 0.4), "specular": dice(0, 0.4)}
    return _material(dice, textures, families, colors, repeats, **fixed)


def smooth(dice: Dice, textures: Textures) -> Material:
    """Paint, paper, plaster, a studio's backdrop."""
    value = dice(0.15, 0.97)
    colors = ramp(dice, dice(), dice() ** 2 * 0.9, (value - 0.03, value + 0.03))
    repeats, fixed = dice(0.2, 0.6), {"drift": dice(0, 0.2), "bump": 0.0, "specular": dice(0, 0.3)}
    return _material(dice, textures, ("cloud", "rough"), colors, repeats, **fixed)


def foliage(dice: Dice, textures: Textures) -> Material:
    """Leaves of trees and bushes, from near or from far."""
    hue, saturation = dice(0.15, 0.4), dice(0.2, 0.7)
    colors = ramp(dice, hue, saturation, (dice(0.02, 0.12), dice(0.35, 0.85)), 0.05)
    families = (dice.pick(("leaves", "leaves", "rough", "blades")), "rough")
    return _material(dice, textures, families, colors, dice(0.2, 1.0), drift=dice(0.3, 0.9))


def bark(dice: Dice, textures: Textures) -> Material:
    """Trunks, and woods seen from far."""
    hue, saturation, values = dice(0.02, 0.1), dice(0.1, 0.5), (dice(0.03, 0.15), dice(0.3, 0.6))
    colors = ramp(dice, hue, saturation, values)
    return _material(dice, textures, ("cracks", "blades"), colors, dice(0.5, 1.5), drift=0.6)


GROUNDS: tuple[Maker, ...] = (grass, grass, soil, soil, stone, stone, laid)
STUDIO_FLOORS: tuple[Maker, ...] = (smooth, smooth, laid)
WALLS: tuple[Maker, ...] = (laid, smooth, stone)
VEGETATION: tuple[Maker, ...] = (foliage, foliage, foliage, bark, grass)


def anything(dice: Dice, textures: Textures) -> Material:
    """A subject's material: any colours, any pattern."""
    style = dice.whole(0, 9)
    specular, shininess = dice() ** 2, 2 ** dice(2, 7)
    if style <= 3:
        material = _mineral(dice, textures)._replace(specular=0.5 * specular)
    elif style <= 6:
        material = _painted(dice, textures)._replace(specular=specular)
    elif style <= 8:
        material = _patterned(dice, textures)._replace(specular=specular)
    else:
        return dice.pick((grass, foliage, bark, soil))(dice, textures)
    return material._replace(shininess=shininess)


def _mineral(dice: Dice, textures: Textures) -> Material:
    """Stone and metal: grey or one hue, speckled."""
    colors = ramp(dice, dice(), dice() ** 2 * 0.6, (dice(0.1, 0.6), dice(0.45, 0.95)))
    first = dice.pick(("speckle", "rough", "cracks", "cells"))
    families = (first, dice.pick(("cloud", "rough", "speckle")))
    return _material(dice, textures, families, colors, dice(0.4, 2.5))


def _painted(dice: Dice, textures: Textures) -> Material:
    """One colour, nearly plain."""
    value = dice(0.2, 0.95)
    colors = ramp(dice, dice(), dice(0, 1), (value - dice(0, 0.15), value + dice(0, 0.1)))
    repeats, fixed = dice(0.3, 1.5), {"drift": dice(0, 0.3), "bump": dice(0, 0.2)}
    return _material(dice, textures, ("cloud", "rough"), colors, repeats, **fixed)


def _patterned(dice: Dice, textures: Textures) -> Material:
    """Two colours in a pattern."""
    values = (dice(0.1, 0.9), dice(0.1, 0.9))
    dark, light = (ramp(dice, dice(), dice(0, 1), (value, value + 0.1)) for value in values)
    colors = torch.cat((dark[:3], light[2:]))
    families = (dice.pick(("print", "print", "masonry", "cloud", "cells", "wood")), "rough")
    repeats, share = dice(0.3, 1.5), dice(0, 0.2)
    return _material(dice, textures, families, colors, repeats, share=share, bump=0.0)


def random_materials(dice: Dice, textures: Textures, studio: bool) -> list[Material]:
    """All of a scene's materials but those of its backdrops, by number."""
    grounds = STUDIO_FLOORS if studio else GROUNDS
    main, *details = (anything(dice, textures) for _ in range(3))
    around = [dice.pick(grounds)(dice, textures) for _ in (GROUND, PATCH)]
    around += [stone(dice, textures), foliage(dice, textures), bark(dice, textures)]
    if dice.chance(0.25):  # all of one make
        details = [main, main]
    if dice.chance(0.15):  # the subject in the colours of what is around it
        main = main._replace(ramp=dice.pick(around[:4]).ramp)
    return [main, *details, *around]
