"""Synthetic scenes with a subject that is known exactly: a figure on a stand, and distractors.

They are no scenes of the training of `small`: other shapes, other surroundings.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, tau

import torch

from gsedit.synthetic import surface_gaussians
from gsedit.synthetic.paint import lit, mix, parts, plain, waves
from gsedit.synthetic.scene import SyntheticScene
from gsedit.synthetic.shapes import (
    Sdf,
    box,
    capsule,
    cylinder,
    smooth_union,
    sphere,
    translate,
    union,
)
from rasterizer.scene import Gaussians

LIGHT = (-0.5, -0.7, 0.9)


@dataclass(frozen=True, eq=False)
class Labelled:
    scene: SyntheticScene
    gaussians: Gaussians
    subject: torch.Tensor
    """One flag a Gaussian."""


def statue(seed: int, count: int = 6000) -> Labelled:
    """A four-legged figure with a long tail on a block, both of similar hue; around it a floor of
    another colour, bushes, and a wall of the figure's own hue far behind."""
    random = torch.Generator().manual_seed(seed)

    def number(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=random))

    def colour(low: float, high: float) -> tuple[float, float, float]:
        return (number(low, high), number(low, high), number(low, high))

    figure = _figure(number)
    coat = colour(0.25, 0.75)
    near = tuple(min(1.0, max(0.0, c + number(-0.08, 0.08))) for c in coat)
    block = translate(box((0.42, 0.25, 0.05), rounding=0.01), (0.0, 0.0, -0.35))
    floor = translate(cylinder(1.0, 0.03), (0.0, 0.0, -0.43))
    angle = number(0, tau)
    wall = translate(box((0.03, 0.35, 0.3)), (0.9, 0.0, -0.1))
    bushes = union(
        *(
            sphere(number(0.07, 0.12), (0.75 * cos(a), 0.75 * sin(a), -0.34))
            for a in (angle, angle + 1.7, angle + 3.1, angle + 4.4)
        )
    )
    painted = (
        (figure, mix(plain(coat), plain(near), waves(0.3))),
        (block, plain(tuple(0.5 * (c + number(0.4, 0.9)) for c in near))),
        (floor, mix(plain(colour(0.2, 0.8)), plain(colour(0.2, 0.8)), waves(0.5))),
        (wall, plain(near)),
        (bushes, mix(plain((0.2, 0.4, 0.15)), plain((0.5, 0.6, 0.2)), waves(0.1))),
    )
    solid = union(*(part for part, _ in painted))
    scene = SyntheticScene(
        name="statue",
        sdf=solid,
        albedo=lit(parts(*painted), solid, LIGHT),
        background=torch.tensor(colour(0.5, 0.95), dtype=torch.float64),
        radius=1.1,
        up=torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64),
    )
    return labelled(scene, figure, union(block, floor, wall, bushes), count, random)


def _figure(number) -> Sdf:
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


def iou(a: torch.Tensor, b: torch.Tensor, weight: torch.Tensor) -> float:
    """Intersection over union of two sets of Gaussians, each counted by its weight."""
    return float(weight[a & b].sum() / weight[a | b].sum())
