"""Animals, people and toys: each about 1 in size, facing +x, standing on z = 0."""

from __future__ import annotations

from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import Solid, ball, drum, limb, rod
from research.train_small.pictures.vectors import turned

SIDES = (-1, 1)


def quadruped(rng: RandomStream) -> list[Solid]:
    """A four-legged animal: bear, dog, cow, horse, by its proportions."""
    leg, length, girth = rng(0.12, 0.5), rng(0.4, 0.75), rng(0.17, 0.34)
    thick = rng(0.05, 0.12) + 0.15 * (girth - 0.17)
    back = leg + girth
    shoulder = back + rng(-0.06, 0.1)
    parts = [
        ball((-0.45 * length, 0, back), (0.55 * length, girth, girth * rng(0.9, 1.15)), 0),
        ball((0.4 * length, 0, shoulder), (0.5 * length, 0.9 * girth, girth), 0),
        ball((0.0, 0, back), (0.7 * length, 0.9 * girth, 0.85 * girth), 0),
    ]
    size = rng(0.12, 0.24)
    head = (length + rng(0.05, 0.3), rng(-0.15, 0.15), back + rng(-0.15, 0.45))
    parts.append(limb((0.6 * length, 0, shoulder), head, 0.8 * max(size, 0.14), 0))
    parts.append(ball(head, (1.15 * size, size, size), 0))
    muzzle = (head[0] + size * rng(0.8, 1.4), head[1], head[2] - size * rng(0.1, 0.5))
    snout = (size * rng(0.5, 0.8), 0.5 * size, 0.45 * size)
    parts.append(ball(muzzle, snout, rng.pick((0, 0, 1))))
    ear = size * rng(0.2, 0.5)
    for side in SIDES:
        spot = (head[0] - 0.3 * size, head[1] + side * 0.75 * size, head[2] + 0.8 * size)
        parts.append(ball(spot, (0.6 * ear, 0.7 * ear, ear * rng(0.9, 2.0)), rng.pick((0, 0, 1))))
        for end, stout in ((-0.75, 1.3), (0.65, 1.1)):
            hip = (end * length, side * 0.6 * girth, back - 0.2 * girth)
            foot = (end * length + rng(-0.2, 0.2), side * 0.6 * girth, thick)
            parts.append(limb(hip, foot, thick * stout, 0))
            paw = (foot[0] + 0.4 * thick, foot[1], 0.6 * thick)
            half = (1.5 * thick, 1.1 * thick, 0.7 * thick)
            parts.append(ball(paw, half, rng.pick((0, 0, 2))))
    if rng.chance(0.6):
        root = (-0.95 * length, 0.0, back + 0.3 * girth)
        tip = (root[0] - rng(0.05, 0.4), rng(-0.2, 0.2), root[2] + rng(-0.4, 0.4))
        parts.append(limb(root, tip, rng(0.03, 0.08), rng.pick((0, 1))))
    return parts


def sitter(rng: RandomStream) -> list[Solid]:
    """A seated or standing toy: bear, rabbit, person."""
    belly, head = rng(0.2, 0.36), rng(0.15, 0.3)
    tall = belly * rng(0.95, 1.5)
    top = 2 * tall + 0.8 * head
    muzzle = (0.85 * head, 0, top - 0.15 * head)
    parts = [
        ball((0, 0, tall), (belly, belly * rng(0.8, 1.05), tall), 0),
        ball((0, 0, top), (head, head, head * rng(0.85, 1.15)), 0),
        ball((0.5 * belly, 0, tall), (0.6 * belly, 0.7 * belly, 0.75 * tall), rng.pick((0, 1))),
        ball(muzzle, (0.4 * head, 0.45 * head, 0.35 * head), rng.pick((0, 1, 1))),
    ]
    ear, lift = head * rng(0.25, 0.5), rng(0.8, 2.5)
    arm, leg = rng(0.06, 0.12), rng(0.08, 0.15)
    raised, seated = rng(-0.35, 0.5), rng.chance(0.6)
    for side in SIDES:
        spot = (0, side * 0.75 * head, top + 0.8 * head)
        parts.append(ball(spot, (0.5 * ear, ear, ear * lift), rng.pick((0, 1))))
        shoulder = (0.0, side * 0.8 * belly, 1.6 * tall)
        hand = (rng(0.0, 0.4), side * (belly + rng(0.0, 0.3)), 1.4 * tall + raised)
        parts.append(limb(shoulder, hand, arm, 0))
        if seated:
            foot = (belly + rng(0.0, 0.3), side * 0.7 * belly, leg)
        else:
            foot = (0.1, side * 0.5 * belly, leg)
        parts.append(limb((0, side * 0.6 * belly, 0.5 * tall), foot, leg, rng.pick((0, 0, 2))))
        if rng.chance(0.6):
            parts.append(ball((0.9 * head, side * 0.35 * head, top + 0.25 * head), 0.11 * head, 2))
    if rng.chance(0.4):
        parts.append(ball((0, 0, 2 * tall - 0.05), (0.8 * belly, 0.8 * belly, 0.08), 1))
    return parts


def bust(rng: RandomStream) -> list[Solid]:
    """A head on a neck and shoulders, with or without hair or a hat."""
    head, neck = rng(0.24, 0.32), rng(0.1, 0.16)
    shoulder, top = rng(0.12, 0.3), 0.0
    parts: list[Solid] = []
    if rng.chance(0.75):
        chest = (0.22, rng(0.35, 0.5), shoulder)
        parts.append(ball((0, 0, 0.5 * shoulder), chest, rng.pick((0, 0, 1))))
        top = 1.2 * shoulder
    middle = top + 0.12 + head
    bridge, tip = (0.9 * head, 0, middle + 0.25 * head), (1.1 * head, 0, middle - 0.15 * head)
    mouth, lips = (0.85 * head, 0, middle - 0.5 * head), (0.14 * head, 0.3 * head, 0.1 * head)
    parts += [
        drum((0, 0, top + 0.1), neck, 0.18, 0, rng(0.8, 1.0)),
        ball((0, 0, middle), (head, 0.8 * head, head * rng(1.1, 1.35)), 0),
        ball((0.35 * head, 0, middle - 0.6 * head), (0.6 * head, 0.55 * head, 0.55 * head), 0),
        limb(bridge, tip, 0.12 * head, 0),
        ball(mouth, lips, rng.pick((0, 1))),
    ]
    for side in SIDES:
        parts.append(ball((0, side * 0.8 * head, middle), (0.2 * head, 0.1 * head, 0.3 * head), 0))
        eye = (0.85 * head, side * 0.32 * head, middle + 0.25 * head)
        parts.append(ball(eye, 0.12 * head, rng.pick((0, 2))))
    if rng.chance(0.6):
        hair = (-0.15 * head, 0, middle + 0.35 * head)
        parts.append(ball(hair, (head, 0.9 * head, 1.05 * head), 1))
    if rng.chance(0.2):
        parts.append(drum((0, 0, middle + 0.9 * head), 1.5 * head, 0.03, 2))
        parts.append(drum((0, 0, middle + 1.3 * head), 0.85 * head, 0.4 * head, 2, rng(0.7, 1.0)))
    return parts


def bird(rng: RandomStream) -> list[Solid]:
    """A bird or a fish: a drop with a head, a beak, a tail and thin legs."""
    size, leg, lean = rng(0.2, 0.32), rng(0.1, 0.45), rng(-0.9, 0.1)
    axes, neck = turned(0.0, lean), rng(0.1, 0.5)
    head = (1.2 * size, 0.0, leg + 1.6 * size + neck)
    beak = (head[0] + 0.6 * size, 0, head[2] - 0.05)
    tail = (-1.8 * size, 0, leg + size + lean * size)
    parts = [
        ball((0.0, 0.0, leg + size), (1.6 * size, 0.8 * size, size), 0, axes),
        limb((0.7 * size, 0, leg + 1.2 * size), head, rng(0.06, 0.12), 0),
        ball(head, (0.5 * size, 0.42 * size, 0.45 * size), rng.pick((0, 1))),
        ball(beak, (0.45 * size, 0.12 * size, 0.12 * size), 2),
        ball(tail, (0.9 * size, 0.4 * size, 0.1), rng.pick((0, 1)), axes),
    ]
    for side in SIDES:
        hip, foot = (0, side * 0.4 * size, leg + 0.4 * size), (0.05, side * 0.4 * size, 0.0)
        parts.append(rod(hip, foot, 0.03, 2))
        wing = (-0.2 * size, side * 0.75 * size, leg + 1.1 * size)
        parts.append(ball(wing, (1.2 * size, 0.2 * size, 0.6 * size), rng.pick((0, 1)), axes))
    return parts


def figure(rng: RandomStream) -> list[Solid]:
    """Make a standing person."""
    broad, hip, arm = rng(0.12, 0.2), rng(0.4, 0.5), rng(0.035, 0.055)
    head = rng(0.075, 0.11)
    parts = [
        ball((0, 0, 0.68), (0.1, broad, 0.24), rng.pick((0, 1))),
        ball((0, 0, hip), (0.1, 0.8 * broad, 0.13), rng.pick((0, 2))),
        ball((0, 0, 0.93 + head), (head, 0.85 * head, 1.2 * head), 0),
        drum((0, 0, 0.92), 0.4 * head + 0.02, 0.06, 0),
    ]
    robe = rng.chance(0.25)
    if robe:
        parts.append(drum((0, 0, 0.28), rng(0.18, 0.3), 0.28, 1, 0.5))
    for side in SIDES:
        hand = (rng(-0.15, 0.3), side * (broad + rng(0.02, 0.3)), rng(0.4, 1.0))
        elbow = (rng(-0.1, 0.1), side * (broad + rng(0.02, 0.15)), 0.62)
        parts.append(limb((0, side * broad, 0.84), elbow, arm, rng.pick((0, 1))))
        parts.append(limb(elbow, hand, 0.9 * arm, 0))
        if not robe:
            knee = (rng(-0.02, 0.15), side * 0.6 * broad, 0.26)
            foot = (rng(-0.15, 0.1), side * 0.7 * broad, 0.04)
            parts.append(limb((0, side * 0.5 * broad, hip), knee, 0.075, rng.pick((0, 2))))
            parts.append(limb(knee, foot, 0.055, rng.pick((0, 2))))
    return parts
