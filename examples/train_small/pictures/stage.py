"""Everything that a picture is of: a random subject in a random place under a random sky."""

from __future__ import annotations

from typing import NamedTuple

from train_small.pictures.backdrops import Backdrop, random_backdrops
from train_small.pictures.camera import Pinhole, random_camera
from train_small.pictures.light import Light, random_light
from train_small.pictures.materials import Material
from train_small.pictures.palette import GROUND, PATCH, random_materials
from train_small.pictures.props import pedestal, random_props
from train_small.pictures.randomness import Dice
from train_small.pictures.sky import Sky, random_sky
from train_small.pictures.solids import Solids, columns
from train_small.pictures.subjects import random_subject
from train_small.pictures.textures import Textures


class Stage(NamedTuple):
    """A scene, its light and its camera."""

    solids: Solids
    backdrops: list[Backdrop]
    materials: list[Material]
    """By the numbers of `palette`; the backdrops' come last, in their order."""
    patch: int
    """The material of patches on the ground: GROUND if there are none."""
    light: Light
    sky: Sky
    camera: Pinhole
    crease: float
    """World units over which touching balls flow into each other."""


def random_stage(dice: Dice, textures: Textures) -> Stage:
    """A subject on a ground or a pedestal, outdoors among props or in a studio."""
    studio = dice.chance(0.15)
    materials = random_materials(dice, textures, studio)
    subject, height = random_subject(dice)
    camera = random_camera(dice, subject)
    solids = subject + (pedestal(dice, height) if height > 0 else [])
    if not studio:
        solids += random_props(dice, camera.heading)
    floor = materials[GROUND] if studio else None
    backdrops = random_backdrops(dice, textures, camera.heading, floor)
    return Stage(
        solids=columns(solids),
        backdrops=backdrops,
        materials=materials + [backdrop.material for backdrop in backdrops],
        patch=GROUND if studio or dice.chance(0.5) else PATCH,
        light=random_light(dice),
        sky=random_sky(dice, textures, studio),
        camera=camera,
        crease=dice(0.02, 0.08),
    )
