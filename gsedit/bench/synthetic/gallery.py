"""Scenes by name: five for measurements, each with its own difficulty, and the one of the demo."""

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
    box,
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


def scenes() -> tuple[SyntheticScene, ...]:
    """Five small scenes, z up, each within a ball of radius 1 to 1.5."""
    return globe(), links(), columns(), cage(), pond()


def globe() -> SyntheticScene:
    """One sphere, unlit: depth, normals and correspondences have closed forms."""
    marble = mix(plain((0.15, 0.3, 0.6)), plain((0.9, 0.85, 0.6)), waves(0.9))
    paint = mix(marble, plain((0.75, 0.25, 0.2)), checker(0.8, sharpness=2.0))
    return _scene("globe", sphere(1.0), paint, background=(0.9, 0.9, 0.9), radius=1.1)


def links() -> SyntheticScene:
    """Three interlocked rings: silhouettes everywhere, holes to look through."""
    ring = torus(0.55, 0.17)
    rings = (
        translate(rotate(ring, (1, 0, 0), 20.0), (-0.55, 0, 0)),
        rotate(ring, (1, 0, 0), 95.0),
        translate(rotate(ring, (1, 0, 0), -15.0), (0.55, 0, 0)),
    )
    coats = (
        mix(plain((0.85, 0.3, 0.25)), plain((0.95, 0.8, 0.6)), stripes((0.6, 0.8, 0), 0.3)),
        mix(plain((0.2, 0.5, 0.35)), plain((0.75, 0.9, 0.5)), waves(0.5)),
        mix(plain((0.2, 0.3, 0.7)), plain((0.6, 0.85, 0.95)), checker(0.4, sharpness=2.0)),
    )
    return _painted("links", zip(rings, coats), background=(0.95, 0.93, 0.88), radius=1.3)


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
    return _painted("columns", painted, (0.75, 0.85, 0.95), radius=1.4)


def cage() -> SyntheticScene:
    """Bars a few pixels wide in front of a rounded box: thin parts, small depth steps."""
    angles = [2 * pi * i / 10 for i in range(10)]
    feet = [(0.75 * cos(a), 0.75 * sin(a)) for a in angles]
    bars = union(*(capsule((x, y, -0.6), (0.5 * x, 0.5 * y, 0.7), 0.035) for x, y in feet))
    hoops = union(
        translate(torus(0.75, 0.045), (0, 0, -0.6)), translate(torus(0.375, 0.045), (0, 0, 0.7))
    )
    block = rotate(box((0.3, 0.3, 0.3), rounding=0.08), (1, 1, 0.3), 40.0)
    painted = (
        (bars, mix(plain((0.85, 0.65, 0.2)), plain((0.55, 0.3, 0.15)), stripes((0, 0, 1), 0.25))),
        (hoops, mix(plain((0.3, 0.3, 0.4)), plain((0.6, 0.6, 0.75)), waves(0.4))),
        (block, mix(plain((0.8, 0.2, 0.4)), plain((0.95, 0.9, 0.85)), checker(0.35))),
    )
    return _painted("cage", painted, background=(0.15, 0.18, 0.22), radius=1.05)


def pond() -> SyntheticScene:
    """Smooth mounds on a wide ground: grazing views, a horizon, no sharp silhouette inside."""
    ground = translate(cylinder(1.3, 0.08, rounding=0.06), (0, 0, -0.35))
    hills = smooth_union(
        0.35,
        ground,
        sphere(0.38, (-0.4, 0.15, -0.1)),
        sphere(0.3, (0.35, -0.3, -0.05)),
        capsule((0.1, 0.5, -0.2), (0.65, 0.35, 0.1), 0.16),
    )
    grass = mix(plain((0.35, 0.55, 0.25)), plain((0.75, 0.75, 0.4)), waves(0.7))
    paint = mix(grass, plain((0.55, 0.3, 0.25)), stripes((0.48, 0.36, 0.8), 0.3))
    return _scene("pond", hills, lit(paint, hills, LIGHT), background=(0.8, 0.88, 0.95), radius=1.4)


def demo_scene() -> SyntheticScene:
    """A teddy bear with a scarf, seated on a plinth on a tiled floor; it faces -y, z is up."""
    return _painted("bear", demo_solids(), (0.74, 0.84, 0.9), radius=1.2)


def demo_solids() -> tuple[tuple[Sdf, Paint], ...]:
    """The solids of the demo scene in their paints, the plinth and the floor last."""
    cloth = mix(
        plain((0.85, 0.13, 0.15)), plain((0.97, 0.93, 0.88)), stripes((0.8, 0, 0.6), 0.14, 2.0)
    )
    painted = (
        (bear_fur(), mix(plain((0.62, 0.38, 0.18)), plain((0.86, 0.6, 0.34)), waves(0.22))),
        (_cream(), mix(plain((0.97, 0.87, 0.7)), plain((0.86, 0.72, 0.52)), waves(0.18))),
        (_eyes_and_nose(), plain((0.07, 0.06, 0.07))),
        (_scarf(), cloth),
        (
            translate(cylinder(0.68, 0.09, rounding=0.03), (0, -0.05, -0.74)),  # the plinth
            mix(plain((0.55, 0.6, 0.66)), plain((0.82, 0.84, 0.86)), waves(0.35)),
        ),
        (
            translate(cylinder(0.86, 0.04, rounding=0.02), (0, -0.05, -0.86)),  # the floor
            mix(plain((0.92, 0.88, 0.8)), _slabs(), tiles(0.28, 0.02)),
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


def _eyes_and_nose() -> Sdf:
    return union(mirror(sphere(0.042, (0.115, -0.285, 0.49))), sphere(0.05, (0, -0.395, 0.39)))


def _scarf() -> Sdf:
    return union(
        translate(rotate(torus(0.225, 0.075), (1, 0, 0), 8.0), (0, -0.01, 0.125)),
        capsule((0.1, -0.28, 0.08), (0.16, -0.4, -0.2), 0.055),
    )


def _shifted(coat: Paint, offset: Triple) -> Paint:
    """The paint of a solid, moved by `offset` with it."""
    return lambda points: coat(points - points.new_tensor(offset))


def _slabs() -> Paint:
    """Terracotta in two tones, chequered as the tiles are laid."""
    return mix(plain((0.72, 0.4, 0.3)), plain((0.45, 0.55, 0.5)), checker(0.56))


def _painted(
    name: str, painted: Iterable[tuple[Sdf, Paint]], background: Triple, radius: float
) -> SyntheticScene:
    """The union of solids, each in its paint, lit from one side."""
    painted = tuple(painted)
    solid, coat = union(*(part for part, _ in painted)), parts(*painted)
    return _scene(name, solid, lit(coat, solid, LIGHT), background, radius)


def _scene(
    name: str, solid: Sdf, paint: Paint, background: Triple, radius: float
) -> SyntheticScene:
    return SyntheticScene(
        name=name,
        sdf=solid,
        albedo=paint,
        background=torch.tensor(background, dtype=torch.float64),
        radius=radius,
        up=torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64),
    )
