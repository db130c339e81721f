"""Pictures of random painted solids, sphere-traced, like the scenes of gsedit.synthetic.

Subjects are the piles of balls, boxes and drums of train_small.pictures, blended smoothly.
"""

from __future__ import annotations

from math import cos, pi, radians, sin
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.synthetic.paint import Paint, checker, lit, mix, parts, plain, stripes, tiles, waves
from gsedit.synthetic.scene import SyntheticScene
from gsedit.synthetic.shapes import (
    Sdf,
    box,
    capsule,
    cylinder,
    length,
    smooth_union,
    sphere,
    translate,
    union,
)
from rasterizer.camera import Camera, look_at
from research.train_small.pictures import BALL, BOX, SUBJECTS, Point, RandomStream, Solid, color
from research.train_small.sources import FAR, Sources, cat

VIEWS = 3  # pictures of one scene
RADIUS = 1.2  # of the ball that a scene fills, as in gsedit.synthetic
SUPERSAMPLE = 1.5  # rays a pixel and axis


class SubjectScene(NamedTuple):
    scene: SyntheticScene
    subject: Sdf
    surroundings: Sdf | None
    """Plinth and floor; a point is on the subject where `subject` is the smaller distance."""


def random_scene(generator: torch.Generator) -> SyntheticScene:
    """Random solids in random paints, lit from one side, on a floor or not; z is up."""
    return subject_scene(RandomStream(generator)).scene


def subject_scene(rng: RandomStream) -> SubjectScene:
    """A random scene, and which of its solids are the subject."""
    solids = _standing(rng.pick(SUBJECTS)(rng))
    blend = rng.pick((0.0, 0.03, 0.07))
    painted = []
    for material in sorted({solid.material for solid in solids}):
        pieces = [_sdf(solid) for solid in solids if solid.material == material]
        whole = smooth_union(blend, *pieces) if blend else union(*pieces)
        painted.append((whole, _paint(rng)))
    subject = union(*(solid for solid, _ in painted))
    below = _surroundings(rng, min(_foot(solid) for solid in solids))
    everything = union(subject, *(solid for solid, _ in below))
    toward_light = (rng(-1, 1), rng(-1, 1), rng(0.2, 1.2))
    scene = SyntheticScene(
        name="random",
        sdf=everything,
        albedo=lit(parts(*painted, *below), everything, toward_light, rng(0.35, 0.75)),
        background=torch.tensor(_color(rng), dtype=torch.float64),
        radius=RADIUS,
        up=torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64),
    )
    return SubjectScene(scene, subject, union(*(solid for solid, _ in below)) if below else None)


def _standing(solids: list[Solid]) -> list[Solid]:
    """The solids centered and scaled into the scene's ball, with room for a floor."""
    low = [min(s.center[i] - max(s.half) for s in solids) for i in range(3)]
    high = [max(s.center[i] + max(s.half) for s in solids) for i in range(3)]
    scale = 1.75 / max(b - a for a, b in zip(low, high))
    middle = [(a + b) / 2 for a, b in zip(low, high)]
    return [
        solid._replace(
            center=tuple(scale * (c - m) for c, m in zip(solid.center, middle)),
            half=tuple(scale * h for h in solid.half),
        )
        for solid in solids
    ]


def _foot(solid: Solid) -> float:
    """The lowest point, about."""
    return solid.center[2] - sum(h * abs(row[2]) for h, row in zip(solid.half, solid.axes))


def _surroundings(rng: RandomStream, level: float) -> list[tuple[Sdf, Paint]]:
    """None, a floor, or a plinth on a floor, with their tops at `level`."""
    made: list[tuple[Sdf, Paint]] = []
    level += 0.02
    if rng.chance(0.4):
        half, wide = rng(0.04, 0.1), rng(0.5, 0.8)
        slab = cylinder(wide, half, 0.02) if rng.chance(0.5) else box((wide, wide, half), 0.02)
        made.append((translate(slab, (0, 0, level - half)), _paint(rng)))
        level -= 2 * half
    if rng.chance(0.8):
        wide = rng(0.8, 1.2)
        disc = cylinder(wide, 0.04, 0.02) if rng.chance(0.7) else box((wide, wide, 0.04), 0.02)
        made.append((translate(disc, (0, 0, level - 0.04)), _paint(rng)))
    return made


def _paint(rng: RandomStream) -> Paint:
    """Two colors, alike or not, in a pattern."""
    first = _color(rng)
    second = tuple(min(max(c + rng(-0.25, 0.25), 0.0), 1.0) for c in first)
    second = _color(rng) if rng.chance(0.4) else second
    share = rng.pick(
        (
            waves(rng(0.15, 0.9)),
            waves(rng(0.15, 0.9)),
            checker(rng(0.25, 0.8), rng(1, 3)),
            stripes(_direction(rng), rng(0.14, 0.5), rng(1, 3)),
            tiles(rng(0.2, 0.4), 0.02),
        )
    )
    return plain(first) if rng.chance(0.2) else mix(plain(first), plain(second), share)


def _color(rng: RandomStream) -> tuple[float, float, float]:
    """A displayed color, grey as often as not."""
    linear = color(rng(), rng() ** 1.7, rng(0.1, 1.0))
    return tuple(c ** (1 / 2.2) for c in linear)  # pyright: ignore


def _direction(rng: RandomStream) -> tuple[float, float, float]:
    azimuth, z = rng(0, 2 * pi), rng(-1, 1)
    level = (1 - z * z) ** 0.5
    return (level * cos(azimuth), level * sin(azimuth), z)


def _sdf(solid: Solid) -> Sdf:
    """A solid of the ray caster as a distance; a long ball becomes a capsule."""
    wide, other, half = solid.half
    upright = abs(solid.axes[2][2]) > 1 - 1e-9
    if solid.kind == BALL and wide == other and half > wide:
        reach = [(half - wide) * a for a in solid.axes[2]]
        start, end = ([c + s * r for c, r in zip(solid.center, reach)] for s in (-1, 1))
        return capsule(start, end, wide)
    if solid.kind == BALL:
        inner = _ellipsoid(solid.half)
        upright = upright and abs(solid.axes[0][0]) > 1 - 1e-9
    elif solid.kind == BOX:
        inner = box(solid.half, 0.15 * min(solid.half))
        upright = upright and abs(solid.axes[0][0]) > 1 - 1e-9
    else:
        radius = wide * (1 + min(solid.taper, 1.0)) / 2
        inner = cylinder(radius, half, 0.2 * min(wide, half))
    if upright:
        return translate(inner, solid.center)
    axes = torch.tensor(solid.axes, dtype=torch.float64)
    center = torch.tensor(solid.center, dtype=torch.float64)[:, None]

    def distance(points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"]:
        # coordinate-major, as the tracer's points are
        return inner((axes @ (points.mT - center)).mT)

    return distance


def _ellipsoid(half: Point) -> Sdf:
    """A stretched ball; scaled by the least half axis, the distance is never overestimated."""
    least = min(half)
    if max(half) - least < 1e-6:
        return sphere(least)

    def distance(points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b"]:
        x, y, z = points.unbind(-1)
        return (length(x / half[0], y / half[1], z / half[2]) - 1) * least

    return distance


def _cameras(rng: RandomStream, size: int) -> list[Camera]:
    """VIEWS random cameras around a scene that see its ball, or a part of it."""
    made = []
    for _ in range(VIEWS):
        azimuth, elevation = rng(0, 2 * pi), radians(rng(-5, 50))
        fov, zoom = rng(30, 60), rng(0.6, 1.1)
        away = zoom * RADIUS / sin(radians(fov) / 2)
        position = away * torch.tensor(
            (cos(azimuth) * cos(elevation), sin(azimuth) * cos(elevation), sin(elevation))
        )
        target = torch.tensor([rng(-0.15, 0.15) for _ in range(3)])
        up = torch.tensor((0.0, 0.0, 1.0))
        made.append(look_at(position, target, up, fov, size, size))
    return made


def _pictured(view: SubjectScene, camera: Camera, size: int) -> Sources:
    """One picture, depth and normals of every sub-pixel averaged."""
    trace = view.scene.trace(camera)
    distance = float(camera.center @ -camera.forward)
    depth = torch.where(trace.hit, trace.depth / distance, FAR).clamp_max(FAR)
    subject = trace.hit
    if view.surroundings is not None:
        points = camera.unproject(camera.pixel_centers()[trace.hit], trace.depth[trace.hit])
        subject = subject.clone()
        subject[trace.hit] = view.subject(points) < view.surroundings(points)
    fields = (trace.image, depth[..., None], trace.normal, subject[..., None])
    fine = Sources(*(field[None].float() for field in fields))
    pooled = fine.resampled(
        lambda planes: F.interpolate(planes, (size, size), mode="bilinear", antialias=True)
    )
    return pooled._replace(
        image=pooled.image.clamp(0, 1),
        depth=pooled.depth.clamp_max(FAR),
        subject=pooled.subject.clamp(0, 1),
    )


def traced(count: int, size: int, generator: torch.Generator) -> Sources:
    """`count` pictures of size^2 pixels of random scenes, VIEWS of each."""
    rng, made = RandomStream(generator), []
    while len(made) < count:
        view = subject_scene(rng)
        for camera in _cameras(rng, round(size * SUPERSAMPLE)):
            made.append(_pictured(view, camera, size))
    return cat(made[:count])
