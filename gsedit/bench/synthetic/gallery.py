"""Scenes by name: one that is hard to see all of, to measure by, and the one of the demo."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, pi, sin

import torch

from gsedit.bench.synthetic.paint import (
    Paint,
    checker,
    lit,
    mix,
    parts,
    plain,
    stripes,
    tiles,
    waves,
)
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import (
    Sdf,
    Triple,
    capsule,
    cylinder,
    mirror,
    rotate,
    smooth_union,
    sphere,
    torus,
    translate,
    union,
)

LIGHT = (-0.5, -0.7, 0.9)  # from the front left above: every scene has a lit and a shaded side
RAISE = (0.0, 0.05, 0.08)  # brings the middle of the bear and its floor to the origin


def columns() -> SyntheticScene:
    """A ring of pillars around a ball on a floor: most of it is hidden from any one camera."""
    angles = [2 * pi * i / 7 for i in range(7)]
    pillar = cylinder(0.13, 0.62, rounding=0.03)
    pillars = union(*(translate(pillar, (0.85 * cos(a), 0.85 * sin(a), 0.0)) for a in angles))
    floor = translate(cylinder(1.15, 0.06, rounding=0.03), (0, 0, -0.66))
    painted = (
        (pillars, mix(plain((0.85, 0.8, 0.7)), plain((0.5, 0.35, 0.3)), stripes((0, 0, 1), 0.3))),
        (
            sphere(0.42, (0, 0, -0.15)),
            mix(plain((0.2, 0.5, 0.7)), plain((0.9, 0.7, 0.2)), waves(0.6)),
        ),
        (floor, mix(plain((0.35, 0.4, 0.35)), plain((0.7, 0.72, 0.65)), checker(0.5))),
    )
    return painted_scene("columns", painted, (0.75, 0.85, 0.95), radius=1.4)


def demo_scene() -> SyntheticScene:
    """A teddy bear with a scarf, seated on a plinth on a tiled floor; it faces -y, z is up."""
    return painted_scene("bear", demo_solids(), (0.74, 0.84, 0.9), radius=1.2)


def demo_solids() -> tuple[tuple[Sdf, Paint], ...]:
    """The solids of the demo scene in their paints, the plinth and the floor last."""
    cloth = mix(
        plain((0.85, 0.13, 0.15)), plain((0.97, 0.93, 0.88)), stripes((0.8, 0, 0.6), 0.14, 2.0)
    )
    painted = (
        (bear_fur(), mix(plain((0.62, 0.38, 0.18)), plain((0.86, 0.6, 0.34)), waves(0.22))),
        (_cream(), mix(plain((0.97, 0.87, 0.7)), plain((0.86, 0.72, 0.52)), waves(0.18))),
        (
            union(mirror(sphere(0.042, (0.115, -0.285, 0.49))), sphere(0.05, (0, -0.395, 0.39))),
            plain((0.07, 0.06, 0.07)),  # eyes and nose
        ),
        (
            union(
                translate(rotate(torus(0.225, 0.075), (1, 0, 0), 8.0), (0, -0.01, 0.125)),
                capsule((0.1, -0.28, 0.08), (0.16, -0.4, -0.2), 0.055),
            ),
            cloth,  # a scarf
        ),
        (
            translate(cylinder(0.68, 0.09, rounding=0.03), (0, -0.05, -0.74)),  # the plinth
            mix(plain((0.55, 0.6, 0.66)), plain((0.82, 0.84, 0.86)), waves(0.35)),
        ),
        (
            translate(cylinder(0.86, 0.04, rounding=0.02), (0, -0.05, -0.86)),  # the floor
            mix(
                plain((0.92, 0.88, 0.8)),
                mix(plain((0.72, 0.4, 0.3)), plain((0.45, 0.55, 0.5)), checker(0.56)),  # terracotta
                tiles(0.28, 0.02),
            ),
        ),
    )
    return tuple((translate(part, RAISE), _shifted(coat, RAISE)) for part, coat in painted)


def bear_fur() -> Sdf:
    """The bear's body, head, ears, limbs and tail."""
    return smooth_union(
        0.07,
        sphere(0.40, (0, 0.02, -0.22)),
        sphere(0.32, (0, 0, 0.42)),
        mirror(
            smooth_union(
                0.05,
                sphere(0.115, (0.235, 0.03, 0.68)),
                capsule((0.34, -0.02, -0.02), (0.47, -0.25, -0.25), 0.115),
                capsule((0.22, -0.15, -0.5), (0.31, -0.52, -0.5), 0.15),
            )
        ),
        sphere(0.1, (0, 0.42, -0.42)),
    )


def _cream() -> Sdf:
    """The muzzle, the belly, the insides of the ears and the soles."""
    return union(
        sphere(0.145, (0, -0.265, 0.345)),
        sphere(0.3, (0, -0.13, -0.24)),
        mirror(sphere(0.075, (0.245, -0.045, 0.69))),
        mirror(sphere(0.115, (0.32, -0.575, -0.495))),
    )


def _shifted(coat: Paint, offset: Triple) -> Paint:
    """The paint of a solid, moved by `offset` with it."""
    return lambda points: coat(points - points.new_tensor(offset))


def painted_scene(
    name: str, painted: Iterable[tuple[Sdf, Paint]], background: Triple, radius: float
) -> SyntheticScene:
    """The union of solids, each in its paint, lit from one side; z is up."""
    painted = tuple(painted)
    solid, coat = union(*(part for part, _ in painted)), parts(*painted)
    return one_scene(name, solid, lit(coat, solid, LIGHT), background, radius)


def one_scene(
    name: str, solid: Sdf, paint: Paint, background: Triple, radius: float
) -> SyntheticScene:
    """A solid in its paint within a ball around the origin; z is up."""
    return SyntheticScene(
        name=name,
        sdf=solid,
        albedo=paint,
        background=torch.tensor(background, dtype=torch.float64),
        radius=radius,
        up=torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64),
    )
