"""A random scene to be pictured: a subject in a place under a sky, with lighting and camera."""

from __future__ import annotations

from typing import NamedTuple

from research.train_small.pictures.backdrops import Backdrop, random_backdrops
from research.train_small.pictures.camera import Pinhole, random_camera
from research.train_small.pictures.lighting import Lighting, random_lighting
from research.train_small.pictures.materials import Material
from research.train_small.pictures.palette import GROUND, PATCH, random_materials
from research.train_small.pictures.props import pedestal, random_props
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.sky import Sky, random_sky
from research.train_small.pictures.solids import Solids, columns
from research.train_small.pictures.subjects import random_subject
from research.train_small.pictures.textures import Textures


class Stage(NamedTuple):
    """A scene, its lighting and its camera."""

    solids: Solids
    backdrops: list[Backdrop]
    materials: list[Material]
    """By the numbers of `palette`; the backdrops' come last, in their order."""
    patch: int
    """The material of patches on the ground: GROUND if there are none."""
    lighting: Lighting
    sky: Sky
    camera: Pinhole
    crease: float
    """World units over which touching balls flow into each other."""


def random_stage(rng: RandomStream, textures: Textures) -> Stage:
    """A subject on a ground or a pedestal, outdoors among props or in a studio."""
    studio = rng.chance(0.15)
    materials = random_materials(rng, textures, studio)
    subject, height = random_subject(rng)
    camera = random_camera(rng, subject)
    solids = subject + (pedestal(rng, height) if height > 0 else [])
    if not studio:
        solids += random_props(rng, camera.heading)
    floor = materials[GROUND] if studio else None
    backdrops = random_backdrops(rng, textures, camera.heading, floor)
    return Stage(
        solids=columns(solids),
        backdrops=backdrops,
        materials=materials + [backdrop.material for backdrop in backdrops],
        patch=GROUND if studio or rng.chance(0.5) else PATCH,
        lighting=random_lighting(rng),
        sky=random_sky(rng, textures, studio),
        camera=camera,
        crease=rng(0.02, 0.08),
    )
