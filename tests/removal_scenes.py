"""Scenes of Gaussians with an object whose removal is known exactly: they were built without it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

import numpy as np
import torch

from gsedit.scene.quaternions import quaternion_of, turn_between
from rasterizer.camera import Camera, look_at
from rasterizer.numerics import color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

SIDE = 0.06
"""Distance of two Gaussians on a surface."""


@dataclass(frozen=True, eq=False)
class Staged:
    """A scene, its object, and the scene as it was before the object came."""

    scene: Gaussians
    inside: torch.Tensor
    truth: Gaussians
    cameras: list[Camera]


def discs(points, normals, colors, side=SIDE, opacity=0.985) -> Gaussians:
    n = len(points)
    quats = np.stack([quaternion_of(turn_between(np.array((0.0, 0, 1)), v)) for v in normals])
    if len(quats) == 1:
        quats = np.repeat(quats, n, 0)
    size = np.array((0.7, 0.7, 0.07)) * side
    return Gaussians(
        torch.tensor(np.asarray(points), dtype=torch.float32),
        torch.tensor(quats, dtype=torch.float32),
        torch.tensor(np.log(size), dtype=torch.float32).expand(n, 3).contiguous(),
        torch.full((n,), log(opacity / (1 - opacity))),
        color_to_sh(torch.tensor(colors, dtype=torch.float32))[:, None],
    )


def sheet(origin, u, v, pattern, side=SIDE) -> Gaussians:
    """A rectangle from `origin` along two edges; `pattern` colors places along them."""
    u, v = np.array(u, float), np.array(v, float)
    a, b = (np.arange(side / 2, np.linalg.norm(e), side) for e in (u, v))
    a, b = (g.reshape(-1) for g in np.meshgrid(a, b))
    across = [e / np.linalg.norm(e) for e in (u, v)]
    points = np.array(origin, float) + a[:, None] * across[0] + b[:, None] * across[1]
    normal = np.cross(*across)
    return discs(points, normal[None], pattern(a, b), side)


def tiles(a, b, base=(0.7, 0.6, 0.5), size=0.5):
    even = ((np.floor(a / size) + np.floor(b / size)) % 2)[:, None]
    return np.array(base) * (0.75 + 0.25 * even) * (0.9 + 0.1 * a / max(a.max(), 1))[:, None]


def grain(a, b, base=(0.55, 0.57, 0.6), seed=3):
    random = np.random.default_rng(seed)
    return np.clip(np.array(base) * (1 + 0.08 * random.standard_normal((len(a), 1))), 0, 1)


def ball(center, radius, color=(0.8, 0.2, 0.15), side=SIDE) -> Gaussians:
    n = int(4 * np.pi * radius**2 / side**2)
    i = np.arange(n) + 0.5
    z = 1 - 2 * i / n
    angle = np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    unit = np.stack((ring * np.cos(angle), ring * np.sin(angle), z), 1)
    shade = 0.6 + 0.4 * (unit[:, 2:] + 1) / 2
    return discs(np.array(center) + radius * unit, unit, np.array(color) * shade, side)


def staged(truth: Gaussians, thing: Gaussians, cameras, shadow=0.0, reach=0.35) -> Staged:
    """The object put into a scene: darker beside it, and bare of Gaussians that no camera sees."""
    away = (truth.means[:, None, :2] - thing.means[None, ::7, :2]).norm(dim=-1).amin(1)
    low = thing.means[:, 2].min()
    near = (truth.means[:, 2] - low).abs() < 0.1
    dark = torch.where(near, (1 - away / reach).clamp(0, 1) * shadow, 0.0)
    sh = truth.sh.clone()
    sh[:, 0] = color_to_sh((0.5 + 0.28209479 * sh[:, 0]) * (1 - dark[:, None]))
    both = concatenate(replace(truth, sh=sh), thing)
    inside = torch.arange(len(both)) >= len(truth)
    from rasterizer.render import contributions

    seen = sum(contributions(both, camera) for camera in cameras)
    kept = (seen > 1e-3) | inside
    return Staged(both[kept], inside[kept], truth, list(cameras))


def ring(count, center, distance, height, size=128, arc=(0, 360)):
    up = torch.tensor((0.0, 0.0, 1.0)).double()
    center = torch.tensor(center).double()
    out = []
    for i in range(count):
        a = np.radians(arc[0] + (arc[1] - arc[0]) * i / count)
        eye = center + torch.tensor((distance * np.cos(a), distance * np.sin(a), height)).double()
        out.append(look_at(eye, center, up, 45.0, size, size))
    return out


def pedestal(size=128, shadow=0.5, pattern=grain) -> Staged:
    """A ball on a slab with edges, over ground; cameras all around."""
    top = sheet((-1, -0.7, 0), (2, 0, 0), (0, 1.4, 0), pattern)
    sides = [
        sheet((-1, -0.7, -0.3), (2, 0, 0), (0, 0, 0.3), grain),
        sheet((-1, 0.7, -0.3), (2, 0, 0), (0, 0, 0.3), grain),
        sheet((-1, -0.7, -0.3), (0, 1.4, 0), (0, 0, 0.3), grain),
        sheet((1, -0.7, -0.3), (0, 1.4, 0), (0, 0, 0.3), grain),
    ]
    floor = sheet(
        (-3, -3, -0.3), (6, 0, 0), (0, 6, 0), lambda a, b: tiles(a, b, (0.4, 0.5, 0.3)), 0.09
    )
    truth = concatenate(top, *sides, floor)
    return staged(truth, ball((0.1, 0, 0.45), 0.45), ring(20, (0, 0, 0.2), 4.0, 1.6, size), shadow)


def before_wall(size=128, pattern=tiles) -> Staged:
    """A ball in front of a wall, on a floor; cameras on one side."""
    floor = sheet((-3, -3, 0), (6, 0, 0), (0, 5, 0), pattern, 0.08)
    wall = sheet((-3, 2, 0), (6, 0, 0), (0, 0, 3), lambda a, b: tiles(a, b, (0.5, 0.6, 0.75)), 0.08)
    cameras = ring(9, (0, 0, 0.5), 4.5, 1.0, size, (-110, -70))
    return staged(concatenate(floor, wall), ball((0, 0.6, 0.6), 0.6), cameras, 0.4)


def corner(size=128) -> Staged:
    """A ball in the corner of two walls and a floor; cameras in the room."""
    floor = sheet((-3, -3, 0), (5, 0, 0), (0, 5, 0), tiles, 0.08)
    back = sheet((-3, 2, 0), (5, 0, 0), (0, 0, 3), lambda a, b: tiles(a, b, (0.5, 0.6, 0.75)), 0.08)
    right = sheet(
        (2, -3, 0), (0, 5, 0), (0, 0, 3), lambda a, b: tiles(a, b, (0.75, 0.7, 0.5)), 0.08
    )
    cameras = ring(9, (0.8, 0.8, 0.5), 4.0, 1.2, size, (190, 260))
    return staged(concatenate(floor, back, right), ball((1.3, 1.3, 0.5), 0.5), cameras, 0.4)


def grass(size=128) -> Staged:
    """A ball in grass: upright needles of many heights and greens."""
    random = np.random.default_rng(1)
    n = 16000
    xy = random.uniform(-2.5, 2.5, (n, 2))
    tall = random.uniform(0.02, 0.12, n)
    points = np.concatenate((xy, tall[:, None]), 1)
    colors = np.array((0.3, 0.5, 0.15)) * random.uniform(0.6, 1.4, (n, 1))
    lean = np.stack(
        (0.3 * random.standard_normal(n), 0.3 * random.standard_normal(n), np.ones(n)), 1
    )
    blades = discs(points, lean, np.clip(colors, 0, 1))
    blades = replace(
        blades,
        log_scales=torch.tensor(
            np.log(np.stack((np.full(n, 0.012), np.full(n, 0.012), tall / 2 + 0.02), 1)),
            dtype=torch.float32,
        ),
    )
    soil = sheet(
        (-2.5, -2.5, 0), (5, 0, 0), (0, 5, 0), lambda a, b: grain(a, b, (0.25, 0.3, 0.12)), 0.08
    )
    return staged(
        concatenate(soil, blades),
        ball((0, 0, 0.5), 0.45),
        ring(20, (0, 0, 0.2), 4.0, 1.8, size),
        0.3,
    )


def db(a, b, mask=None) -> float:
    e = (a.clamp(0, 1) - b.clamp(0, 1)).square().mean(-1)
    e = e if mask is None else e[mask]
    return -10 * float(e.mean().clamp_min(1e-12).log10()) if e.numel() else float("inf")


def judged(case: Staged, after: Gaussians, cameras) -> dict[str, float]:
    """Decibels in the hole (all of it; what dropping gets wrong), and outside of its shadow."""
    dropped = case.scene[~case.inside]
    rows = {"hole": [], "unseen": [], "drop": [], "outside": []}
    for camera in cameras:
        true, now, cut, was = (render(s, camera) for s in (case.truth, after, dropped, case.scene))
        marked = render(case.scene, camera, marked=case.inside).marked
        hole = marked > 0.1
        unseen = hole & ((cut.color - true.color).abs().amax(-1) > 0.02)
        far = torch.nn.functional.max_pool2d(hole[None, None].float(), 31, 1, 15)[0, 0] < 0.5
        rows["hole"].append(((now.color - true.color).square().mean(-1))[hole])
        rows["unseen"].append(((now.color - true.color).square().mean(-1))[unseen])
        rows["drop"].append(((cut.color - true.color).square().mean(-1))[unseen])
        rows["outside"].append(((now.color - was.color).square().mean(-1))[far])
    return {k: -10 * float(torch.cat(v).mean().clamp_min(1e-9).log10()) for k, v in rows.items()}
