"""Stages by name, each with its own difficulty for taking a thing away."""

from __future__ import annotations

import torch

from bench.staged.stage import Rig, Stage
from bench.staged.thing import Daylight, Thing
from gsedit.bench.synthetic.paint import (
    Paint,
    Pattern,
    Shares,
    checker,
    mix,
    plain,
    stripes,
    tiles,
    waves,
)
from gsedit.bench.synthetic.shapes import (
    Points,
    Sdf,
    Triple,
    box,
    capsule,
    cut_off,
    cylinder,
    rotate,
    smooth_union,
    sphere,
    torus,
    translate,
    union,
)
from gsedit.views.noise import noise

AFTERNOON = Daylight((-0.5, -0.65, 0.85), (0.85, 0.8, 0.7), (0.4, 0.45, 0.52))
MORNING = Daylight((0.7, -0.5, 0.6), (0.9, 0.78, 0.6), (0.36, 0.42, 0.55))
FLOOR = -0.45
"""Height of the ground of every stage, world units."""


def stages() -> tuple[Stage, ...]:
    """All stages; each call makes them anew."""
    return tuple(make() for make in SETS.values())


def stage(name: str) -> Stage:
    """The stage with a name of SETS; KeyError without one."""
    return SETS[name]()


def pedestal() -> Stage:
    """A statue on a pedestal on a tiled floor: it hides the middle of the top that it stands on."""
    top = FLOOR + 0.32
    stone = mix(plain((0.6, 0.6, 0.58)), plain((0.78, 0.77, 0.72)), waves(0.3))
    body = smooth_union(
        0.06,
        sphere(0.17, (0, 0, top + 0.15)),
        sphere(0.12, (0, 0, top + 0.4)),
        capsule((0.1, 0, top + 0.25), (0.24, -0.02, top + 0.42), 0.045),
        capsule((-0.1, 0, top + 0.25), (-0.2, -0.08, top + 0.12), 0.045),
    )
    foot = translate(cylinder(0.16, 0.03, 0.01), (0, 0, top + 0.03))
    statue = Thing(
        "orange statue",
        cut_off(union(body, foot), top),
        mix(plain((0.85, 0.5, 0.2)), plain((0.95, 0.72, 0.35)), waves(0.2)),
        (-0.29, -0.17, top),
        (0.29, 0.17, top + 0.52),
    )
    block = _box("gray pedestal", (0, 0, FLOOR + 0.16), (0.36, 0.36, 0.16), stone, 0.015)
    return Stage(
        "pedestal", (_ground("tiled floor", _slabs()), block), (statue,), AFTERNOON, _ring()
    )


def meadow() -> Stage:
    """A ball and a post on grass: a texture without lines, noise of many sizes."""
    ball = _ball("red ball", (-0.12, 0, FLOOR), 0.27, _striped((0.8, 0.12, 0.1), (0.95, 0.85, 0.8)))
    post = _pillar("blue post", (0.55, 0.3, FLOOR), 0.07, 0.6, plain((0.15, 0.25, 0.7)))
    return Stage("meadow", (_ground("grass", _grass()),), (ball, post), MORNING, _ring())


def wall() -> Stage:
    """A crate before a brick wall, seen from the front only: its back is never seen."""
    crate = _box(
        "blue crate", (0.05, 0.1, FLOOR + 0.24), (0.24, 0.2, 0.24),
        mix(plain((0.12, 0.3, 0.65)), plain((0.3, 0.5, 0.85)), stripes((0, 0, 1), 0.16, 3.0)),
        0.02,
    )  # fmt: skip
    bricks = _box("brick wall", (0, 0.75, 0.3), (1.5, 0.06, 0.75), _bricks(), 0.01)
    places = tuple((a, e) for e in (8.0, 24.0) for a in (-125.0, -112, -99, -86, -73, -60))
    aside = ((-118.0, 15.0), (-92.0, 18.0), (-67.0, 12.0))
    rig = Rig(places, aside, (0, 0.1, -0.1), 2.3)
    return Stage("wall", (_ground("wooden floor", _boards()), bricks), (crate,), AFTERNOON, rig)


def corner() -> Stage:
    """A ring and a box in the corner of two walls: three planes meet behind them."""
    hoop = Thing(
        "green ring",
        translate(rotate(torus(0.22, 0.085), (1, 0, 0), 90.0), (0.05, 0.1, FLOOR + 0.305)),
        mix(plain((0.1, 0.5, 0.2)), plain((0.4, 0.75, 0.3)), waves(0.3)),
        (-0.255, 0.015, FLOOR),
        (0.355, 0.185, FLOOR + 0.61),
    )
    carton = _box(
        "yellow box", (0.42, 0.36, FLOOR + 0.15), (0.15, 0.15, 0.15),
        mix(plain((0.85, 0.7, 0.15)), plain((0.95, 0.85, 0.45)), waves(0.2)), 0.015,
    )  # fmt: skip
    paper = mix(plain((0.86, 0.82, 0.72)), plain((0.7, 0.62, 0.55)), stripes((1, 0, 0), 0.24, 3.0))
    back = _box("striped wall", (0, 0.72, 0.2), (1.5, 0.06, 0.65), paper, 0.01)
    side = _box(
        "green wall", (0.78, 0, 0.2), (0.06, 1.5, 0.65),
        mix(plain((0.5, 0.62, 0.52)), plain((0.6, 0.7, 0.6)), waves(0.4)), 0.01,
    )  # fmt: skip
    places = tuple((a, e) for e in (15.0, 38.0) for a in (-178.0, -158, -138, -118, -98))
    rig = Rig(places, ((-168.0, 26.0), (-133.0, 22.0), (-108.0, 30.0)), (0.1, 0.1, -0.15), 2.2)
    checkers = mix(plain((0.3, 0.32, 0.36)), plain((0.8, 0.8, 0.76)), checker(0.5))
    floor = _ground("checkered floor", checkers)
    return Stage("corner", (floor, back, side), (hoop, carton), MORNING, rig)


def table() -> Stage:
    """Seven things of different color, kind and size on a table; some touch."""
    top = FLOOR + 0.3
    wood = mix(plain((0.5, 0.33, 0.2)), plain((0.66, 0.46, 0.28)), stripes((0, 1, 0), 0.13, 1.5))
    board = translate(cylinder(0.85, 0.05, 0.02), (0, 0, top - 0.05))
    leg = translate(cylinder(0.14, 0.13), (0, 0, FLOOR + 0.12))
    desk = Thing("wooden table", union(board, leg), wood, (-0.85, -0.85, FLOOR), (0.85, 0.85, top))
    things = (
        _ball("large red ball", (-0.33, 0.12, top), 0.21, plain((0.75, 0.1, 0.1))),
        _ball("small red ball", (0.3, -0.42, top), 0.09, plain((0.8, 0.15, 0.12))),
        _ball("blue ball", (-0.1, -0.33, top), 0.13, plain((0.1, 0.22, 0.7))),
        _box(
            "green box", (0.2, 0.18, top + 0.14), (0.16, 0.16, 0.14), plain((0.12, 0.5, 0.2)), 0.01
        ),
        _ball("yellow ball", (0.2, 0.18, top + 0.28), 0.1, plain((0.92, 0.78, 0.12))),
        _pillar("white pillar", (0.5, 0.1, top), 0.08, 0.45, plain((0.9, 0.9, 0.88))),
        _pillar("purple disc", (-0.5, -0.32, top), 0.13, 0.07, plain((0.45, 0.15, 0.55))),
    )
    floor = _ground(
        "gray floor", mix(plain((0.42, 0.43, 0.45)), plain((0.55, 0.55, 0.56)), waves(0.4))
    )
    rig = _ring(target=(0, 0, -0.1), distance=2.5)
    return Stage("table", (floor, desk), things, AFTERNOON, rig)


def glimpse() -> Stage:
    """A cone-like bollard that three of eight cameras show; the others look past it."""
    bollard = Thing(
        "orange bollard",
        smooth_union(
            0.05,
            capsule((0.1, 0.05, FLOOR + 0.1), (0.1, 0.05, FLOOR + 0.45), 0.1),
            translate(cylinder(0.19, 0.04, 0.015), (0.1, 0.05, FLOOR + 0.04)),
        ),
        _striped((0.9, 0.4, 0.08), (0.95, 0.93, 0.9), (0, 0, 1), 0.2),
        (-0.09, -0.14, FLOOR),
        (0.29, 0.24, FLOOR + 0.55),
    )
    stone = _ball("gray stone", (-0.6, -0.35, FLOOR - 0.06), 0.17, plain((0.5, 0.5, 0.5)))
    paving = mix(
        plain((0.55, 0.52, 0.48)), _slabs((0.7, 0.6, 0.5), (0.62, 0.62, 0.6)), tiles(0.2, 0.02)
    )
    places = ((-110.0, 22.0), (-90.0, 32.0), (-68.0, 24.0))
    rig = Rig(places, ((-100.0, 27.0), (-79.0, 25.0)), (0, 0, -0.2), 2.3)
    return Stage("glimpse", (_ground("paving", paving),), (bollard, stone), MORNING, rig)


SETS = {
    "pedestal": pedestal,
    "meadow": meadow,
    "wall": wall,
    "corner": corner,
    "table": table,
    "glimpse": glimpse,
}


def _ring(target: Triple = (0.0, 0.0, -0.12), distance: float = 2.6) -> Rig:
    """Eight cameras low and six high all around; three to measure at between them."""
    low = tuple((-90 + 45.0 * i, 18.0) for i in range(8))
    high = tuple((-70 + 60.0 * i, 42.0) for i in range(6))
    held_out = ((-68.0, 28.0), (40.0, 24.0), (165.0, 34.0))
    return Rig((*low, *high), held_out, target, distance)


def _ground(name: str, coat: Paint, radius: float = 1.4) -> Thing:
    solid = translate(cylinder(radius, 0.06, 0.02), (0, 0, FLOOR - 0.06))
    return Thing(name, solid, coat, (-radius, -radius, FLOOR - 0.12), (radius, radius, FLOOR))


def _ball(name: str, at: Triple, radius: float, coat: Paint) -> Thing:
    """A ball whose lowest point is at `at`."""
    x, y, z = at
    solid = sphere(radius, (x, y, z + radius))
    low, high = (x - radius, y - radius, z), (x + radius, y + radius, z + 2 * radius)
    return Thing(name, solid, coat, low, high)


def _box(name: str, middle: Triple, half: Triple, coat: Paint, rounding: float) -> Thing:
    low = tuple(m - h for m, h in zip(middle, half))
    high = tuple(m + h for m, h in zip(middle, half))
    return Thing(name, translate(box(half, rounding), middle), coat, low, high)


def _pillar(name: str, at: Triple, radius: float, height: float, coat: Paint) -> Thing:
    """An upright cylinder whose foot is at `at`."""
    x, y, z = at
    solid: Sdf = translate(cylinder(radius, height / 2, 0.015), (x, y, z + height / 2))
    low, high = (x - radius, y - radius, z), (x + radius, y + radius, z + height)
    return Thing(name, solid, coat, low, high)


def _striped(
    first: Triple, second: Triple, direction: Triple = (0.6, 0.0, 0.8), period: float = 0.22
) -> Paint:
    return mix(plain(first), plain(second), stripes(direction, period, 3.0))


def _slabs(first: Triple = (0.75, 0.52, 0.42), second: Triple = (0.8, 0.76, 0.68)) -> Paint:
    slab = mix(plain(first), plain(second), checker(0.56))
    return mix(plain((0.45, 0.43, 0.4)), slab, tiles(0.28, 0.025))


def _grass() -> Paint:
    """Tufts and blades: noise of three sizes, without lines."""
    fine = mix(plain((0.17, 0.32, 0.08)), plain((0.5, 0.6, 0.2)), _cloud(0.03, 1))
    tufts = mix(fine, plain((0.24, 0.42, 0.12)), _cloud(0.09, 2))
    return mix(tufts, plain((0.58, 0.56, 0.28)), lambda points: 0.6 * _cloud(0.35, 3)(points))


def _cloud(size: float, seed: int) -> Pattern:
    """A share without lines or repetition, of features of about `size` world units."""

    def share(points: Points) -> Shares:
        value = noise(points.reshape(-1, 3) / size, seed).reshape(points.shape[:-1])
        return 0.5 + 0.5 * (0.9 * value).tanh()

    return share


def _boards() -> Paint:
    board = mix(plain((0.55, 0.38, 0.24)), plain((0.68, 0.5, 0.33)), waves(0.5))
    return mix(board, plain((0.33, 0.22, 0.14)), lambda p: stripes((1, 0, 0), 0.2)(p) ** 8)


def _bricks() -> Paint:
    """Rows of bricks in mortar, every second row shifted by half a brick."""
    brick = mix(plain((0.58, 0.27, 0.2)), plain((0.72, 0.4, 0.3)), waves(0.35))

    def mortar(points: Points) -> Shares:
        row = (points[..., 2] / 0.18).floor()
        across = (points[..., 0] / 0.38 + 0.5 * (row % 2)) % 1
        along = (points[..., 2] / 0.18) % 1
        to_edge = torch.minimum(
            0.38 * (0.5 - (across - 0.5).abs()), 0.18 * (0.5 - (along - 0.5).abs())
        )
        return (1.5 - to_edge / 0.015).clamp(0, 1)

    return mix(brick, plain((0.78, 0.75, 0.7)), mortar)
