"""Scenes with a subject that is known exactly: a figure on a stand, and distractors around it.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin, tau

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.bench.synthetic.paint import lit, mix, parts, plain, waves
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import (
    Sdf,
    Triple,
    box,
    capsule,
    cylinder,
    smooth_union,
    sphere,
    translate,
    union,
)
from gsedit.bench.synthetic.splats import surface_gaussians
from rasterizer.scene import Gaussians

LIGHT = (-0.5, -0.7, 0.9)


@dataclass(frozen=True, eq=False)
class Labelled:
    """A scene and the Gaussians of its subject."""

    scene: SyntheticScene
    gaussians: Gaussians
    subject: Bool[Tensor, " n"]


def statue(seed: int, count: int = 6000) -> Labelled:
    """A four-legged figure with a long tail on a block, both of similar hue; around it a floor of
    another color, bushes, and a wall of the figure's own hue far behind."""
    random = torch.Generator().manual_seed(seed)

    def number(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=random))

    def color(low: float, high: float) -> Triple:
        return (number(low, high), number(low, high), number(low, high))

    figure = _figure(number)
    coat = color(0.25, 0.75)
    near = _varied(coat, number)
    block = translate(box((0.42, 0.25, 0.05), rounding=0.01), (0.0, 0.0, -0.35))
    floor = translate(cylinder(1.0, 0.03), (0.0, 0.0, -0.43))
    angle = number(0.0, tau)
    wall = translate(box((0.03, 0.35, 0.3)), (0.9, 0.0, -0.1))
    bushes = union(
        *(
            sphere(number(0.07, 0.12), (0.75 * cos(a), 0.75 * sin(a), -0.34))
            for a in (angle, angle + 1.7, angle + 3.1, angle + 4.4)
        )
    )
    painted = (
        (figure, mix(plain(coat), plain(near), waves(0.3))),
        (block, plain(_greyed(near, number))),
        (floor, mix(plain(color(0.2, 0.8)), plain(color(0.2, 0.8)), waves(0.5))),
        (wall, plain(near)),
        (bushes, mix(plain((0.2, 0.4, 0.15)), plain((0.5, 0.6, 0.2)), waves(0.1))),
    )
    solid = union(*(part for part, _ in painted))
    scene = SyntheticScene(
        name="statue",
        sdf=solid,
        albedo=lit(parts(*painted), solid, LIGHT),
        background=torch.tensor(color(0.5, 0.95), dtype=torch.float64),
        radius=1.1,
        up=torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64),
    )
    return labelled(scene, figure, union(block, floor, wall, bushes), count, random)


def _varied(color: Triple, number: Callable[[float, float], float]) -> Triple:
    """A color that differs little."""
    r, g, b = (min(1.0, max(0.0, c + number(-0.08, 0.08))) for c in color)
    return r, g, b


def _greyed(color: Triple, number: Callable[[float, float], float]) -> Triple:
    """A brighter color of similar hue."""
    r, g, b = (0.5 * (c + number(0.4, 0.9)) for c in color)
    return r, g, b


def _figure(number: Callable[[float, float], float]) -> Sdf:
    """Body, head, four legs, and a tail that is as long as the body."""
    length, width = number(0.22, 0.3), number(0.09, 0.12)
    legs = [
        capsule((x, y, -0.05), (x + number(-0.03, 0.03), y, -0.3), number(0.035, 0.05))
        for x in (-0.8 * length, 0.8 * length)
        for y in (-0.07, 0.07)
    ]
    return smooth_union(
        0.04,
        capsule((-length, 0.0, 0.0), (length, 0.0, 0.0), width + 0.03),
        sphere(number(0.1, 0.14), (length + 0.1, 0.0, number(0.08, 0.18))),
        capsule((-length, 0.0, 0.0), (-length - 0.25, number(-0.1, 0.1), number(0.0, 0.2)), 0.03),
        *legs,
    )


def labelled(
    scene: SyntheticScene, subject: Sdf, others: Sdf, count: int, random: torch.Generator
) -> Labelled:
    """The Gaussians of a scene; each belongs to the nearer one of `subject` and `others`."""
    gaussians = surface_gaussians(scene, count, random)
    points = gaussians.means.double()
    return Labelled(scene, gaussians, subject(points) < others(points))
