"""Vessels, furniture, buildings, vehicles, rocks: each about 1 in size, standing on z = 0."""

from __future__ import annotations

from itertools import product

from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import Solid, ball, box, drum, rod
from research.train_small.pictures.vectors import UPRIGHT, turned

SIDES = (-1, 1)
CORNERS = tuple(product(SIDES, SIDES))


def vase(rng: RandomStream) -> list[Solid]:
    """A turned body: drums of changing radius, perhaps a bulge, handles or a lid."""
    height, parts, radius = 0.0, [], rng(0.12, 0.35)
    for _ in range(rng.integer(2, 6)):
        half, taper = rng(0.05, 0.2), rng(0.6, 1.5)
        center = (0, 0, height + half)
        if rng.chance(0.35):
            parts.append(ball(center, (1.1 * radius, 1.1 * radius, 1.3 * half), 0))
        else:
            parts.append(drum(center, radius, half, rng.pick((0, 0, 1)), taper))
            radius *= taper
        radius, height = min(max(radius, 0.06), 0.45), height + 1.9 * half
    if rng.chance(0.4):
        for side in SIDES:
            parts.append(ball((0.0, side * (radius + 0.12), 0.6 * height), (0.05, 0.14, 0.2), 0))
    if rng.chance(0.3):
        parts.append(ball((0, 0, height), radius * rng(0.8, 1.5), 2))
    return parts


def furniture(rng: RandomStream) -> list[Solid]:
    """A chair, a table, a bench or a shelf."""
    wide, deep, seat, thick = rng(0.25, 0.7), rng(0.2, 0.4), rng(0.25, 0.6), rng(0.02, 0.06)
    parts = [box((0, 0, seat), (deep, wide, rng(0.02, 0.08)), rng.pick((0, 1)))]
    turned_legs = rng.chance(0.4)
    for x, y in CORNERS:
        spot = (x * 0.85 * deep, y * 0.88 * wide, seat / 2)
        square = box(spot, (thick, thick, seat / 2), 0)
        parts.append(drum(spot, thick, seat / 2, 0) if turned_legs else square)
    if rng.chance(0.7):
        rise = rng(0.2, 0.5)
        back = (rng(0.02, 0.1), wide, rise)
        parts.append(box((-0.9 * deep, 0, seat + rise), back, rng.pick((0, 1))))
    if rng.chance(0.35):
        for y in SIDES:
            arm = (0, y * 0.92 * wide, seat + 0.17)
            parts.append(box(arm, (deep, 0.06, 0.15), rng.pick((0, 1))))
    return parts


def blocks(rng: RandomStream) -> list[Solid]:
    """Boxes and drums, one on another: a house, a machine, a robot, a monument."""
    height, parts = 0.0, []
    half = (rng(0.15, 0.6), rng(0.15, 0.6), rng(0.1, 0.35))
    for _ in range(rng.integer(1, 4)):
        axes = turned(rng(-0.4, 0.4)) if rng.chance(0.3) else UPRIGHT
        center = (rng(-0.05, 0.05), rng(-0.05, 0.05), height + half[2])
        parts.append(box(center, half, rng.pick((0, 0, 1, 2)), axes))
        height += 2 * half[2]
        half = (half[0] * rng(0.4, 1.05), half[1] * rng(0.4, 1.05), rng(0.06, 0.35))
    if rng.chance(0.4):
        dome = ball((0, 0, height + 0.1), rng(0.1, 0.25), 1)
        spire = drum((0, 0, height + 0.2), rng(0.1, 0.4), 0.2, 1, rng(0.05, 0.9))
        parts.append(rng.pick((dome, spire)))
    return parts


def car(rng: RandomStream) -> list[Solid]:
    """A vehicle along x: a body, a cabin and wheels."""
    long, wide, low, wheel = rng(0.55, 0.9), rng(0.25, 0.38), rng(0.1, 0.2), rng(0.1, 0.18)
    shape, swell = (ball, 1.25) if rng.chance(0.5) else (box, 1.0)
    cabin = (rng(-0.2, 0.1), 0, wheel + 2 * low + 0.08)
    half = (swell * long * rng(0.4, 0.7), swell * 0.85 * wide, swell * rng(0.12, 0.22))
    parts = [
        box((0, 0, wheel + low), (long, wide, low), 0),
        shape(cabin, half, rng.pick((0, 1))),
    ]
    for x, y in CORNERS:
        inner, outer = ((x * 0.65 * long, y * reach, wheel) for reach in (wide - 0.06, wide + 0.03))
        parts.append(rod(inner, outer, wheel, 2))
    return parts


def boulders(rng: RandomStream) -> list[Solid]:
    """A random clump of balls: a rock, a fruit, a cloud of clay."""
    parts = []
    for _ in range(rng.integer(1, 8)):
        half = (rng(0.1, 0.4), rng(0.1, 0.4), rng(0.1, 0.35))
        center = (rng(-0.35, 0.35), rng(-0.35, 0.35), half[2] * 0.8 + rng(0.0, 0.4) ** 2 * 2)
        material = rng.pick((0, 0, 0, 1))
        axes = turned(rng(0, 6.3), rng(-0.6, 0.6), rng(-0.6, 0.6))
        parts.append(ball(center, half, material, axes))
    return parts


def tower(rng: RandomStream) -> list[Solid]:
    """Tall and thin: a column, a lamp, a bottle, a statue's pillar, a tree in a pot."""
    height, radius = rng(0.5, 0.9), rng(0.04, 0.16)
    parts = [drum((0, 0, height), radius, height, 0, rng(0.4, 1.05))]
    if rng.chance(0.7):
        foot, material = radius * rng(1.3, 3.0), rng.pick((0, 1))
        parts.append(drum((0, 0, 0.05), foot, 0.05, material, rng(0.6, 1.0)))
    crown = rng(0.08, 0.35)
    top = (0.0, 0.0, 2 * height)
    crowns = (
        ball(top, (crown, crown, crown * rng(0.7, 1.5)), 1),
        drum(top, crown, rng(0.05, 0.25), 1, rng(0.3, 1.2)),
        box(top, (crown, crown, crown), 1),
    )
    return [*parts, rng.pick(crowns)]
