"""Gaussians that look like a synthetic scene: flat discs spread evenly over its surface.

`n` points requested, `m` candidates. Spacing is the square root of a point's share of the area.
"""

from __future__ import annotations

from math import log, pi, sqrt

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from torch import Tensor

from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import Sdf, gradient
from gsedit.views.orbit import circle, perpendicular
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians

OPACITY = 0.985  # below the cap of alpha: at it, float32 and float64 disagree on the gradient
PROBES = 8  # directions in which a disc is tried against the surface
OVERHANG = 0.2  # how far, in its radii, a disc may leave the surface at its own rim


def surface_points(
    scene: SyntheticScene, count: int, generator: torch.Generator
) -> Float[Tensor, "n 3"]:
    """`count` points spread evenly over the surface, within 1e-9 of it; float64."""
    return _even_points(scene, count, generator)[0]


def surface_gaussians(
    scene: SyntheticScene,
    count: int,
    generator: torch.Generator,
    sh_degree: int = 0,
    sink: float = 0.38,  # depth of the centers under the surface, in spacings
) -> Gaussians:
    """`count` opaque discs along the surface in its colors, float32; SH above degree 0 is zero.

    The centers lie `sink` spacings under the surface (0: on it). A renderer widens every splat by a
    fraction of a pixel and blends the front of a layer of discs first, so discs *on* a surface are
    drawn too large and too near. Sunk by a third of their spacing, they are drawn in place.
    """
    points, spacing = _even_points(scene, count, generator)
    normals = torch.nn.functional.normalize(gradient(scene.sdf, points), dim=-1)
    # alpha is above 0.97 between neighbors
    radius = _fitting_radius(scene.sdf, points, normals, 0.7 * spacing)
    scales = torch.stack((radius, radius, 0.1 * radius), -1)
    sh = points.new_zeros((count, (sh_degree + 1) ** 2, 3))
    sh[:, 0] = color_to_sh(scene.albedo(points))
    return Gaussians(
        means=points - sink * spacing * normals,
        quats=_z_to(normals),
        log_scales=scales.log(),
        logit_opacities=points.new_full((count,), log(OPACITY / (1 - OPACITY))),
        sh=sh,
    ).to(torch.float32)


def _even_points(
    scene: SyntheticScene, count: int, generator: torch.Generator
) -> tuple[Float[Tensor, "n 3"], float]:
    """Points spread evenly over the surface, and their spacing in world units."""
    candidates, area = _candidates(scene, 5 * count, generator)
    spacing = sqrt(area / count)
    # candidates come in random order, so "first come" is a fair draw; about `count` are left
    apart = _first_come(candidates, 0.75 * spacing)
    order = torch.cat((apart.nonzero(), (~apart).nonzero())).squeeze(-1)
    return candidates[order[:count]], spacing


def _candidates(
    scene: SyntheticScene, count: int, generator: torch.Generator
) -> tuple[Float[Tensor, "m 3"], float]:
    """At least `count` points, uniform by area, and the area of the surface (within percents).

    A thin layer of constant thickness is sampled by volume, then projected along the gradient.
    """
    shell = 0.03 * scene.radius
    cube = (2 * scene.radius) ** 3
    found, drawn = torch.empty((0, 3), dtype=torch.float64), 0
    while len(found) < count:
        layer = found.new_empty((0, 3))
        while len(layer) < count - len(found):  # many are projected at once
            cloud = torch.rand((1 << 16, 3), generator=generator, dtype=torch.float64)
            cloud = (2 * cloud - 1) * scene.radius
            near = cloud[scene.sdf(cloud).abs() < shell]
            if not len(near):
                raise ValueError(f"scene {scene.name} has no surface within its radius")
            layer, drawn = torch.cat((layer, near)), drawn + len(cloud)
        layer = _project(scene.sdf, layer)
        found = torch.cat((found, layer[layer.norm(dim=-1) < scene.radius]))
    return found, cube * len(found) / drawn / (2 * shell)


def _project(sdf: Sdf, points: Float[Tensor, "m 3"]) -> Float[Tensor, "k 3"]:
    """The points moved onto the surface along the gradient; those that miss it are left out."""
    for _ in range(6):  # Newton: 4 are enough from this shell
        slope = gradient(sdf, points)
        square = (slope * slope).sum(-1, keepdim=True).clamp_min(0.01)  # 0 on a medial axis
        points = points - sdf(points)[..., None] * slope / square
    return points[sdf(points).abs() < 1e-9]  # others lie between two solids


def _first_come(points: Float[Tensor, "m 3"], distance: float) -> Bool[Tensor, " m"]:
    """A mask of points of which no two are nearer than `distance`; no further point fits in.

    The greedy rule "earlier points win" in rounds, all points at once: a point with no earlier
    undecided neighbor is selected, and its neighbors are removed.
    """
    pairs = KDTree(points.numpy()).query_pairs(distance, output_type="ndarray")  # i < j
    first, second = torch.from_numpy(pairs.astype(np.int64)).unbind(-1)
    removed = torch.zeros(len(points), dtype=torch.bool)
    while len(first):
        has_earlier = torch.zeros_like(removed)
        has_earlier[second] = True
        selected = ~has_earlier & ~removed
        removed[second[selected[first]]] = True
        undecided = ~(removed[first] | removed[second] | selected[first])
        first, second = first[undecided], second[undecided]
    return ~removed


def _fitting_radius(
    sdf: Sdf, points: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"], radius: float
) -> Float[Tensor, " n"]:
    """Disc radii, shrunk where the surface bends away from the disc: at edges and on thin parts."""
    across = perpendicular(normals)
    along = torch.linalg.cross(normals, across)
    overhang = torch.zeros(len(points), dtype=points.dtype)
    for i in range(PROBES):
        angle = torch.tensor(2 * pi * i / PROBES, dtype=points.dtype)
        rim = points + radius * (angle.cos() * across + angle.sin() * along)
        overhang = torch.maximum(overhang, sdf(rim).abs() / radius)
    return radius * (OVERHANG / overhang.clamp_min(OVERHANG))


def _z_to(normals: Float[Tensor, "n 3"]) -> Float[Tensor, "n 4"]:
    """Unit quaternions that turn the z axis to the normals, up to sign: a disc has no front."""
    x, y, z = torch.where(normals[:, 2:] < 0, -normals, normals).unbind(-1)
    # half-way formula; 1 + z is at least 1 after the flip, so it never degenerates
    return torch.nn.functional.normalize(
        torch.stack((1 + z, -y, x, torch.zeros_like(z)), -1), dim=-1
    )


def ring_cameras(
    scene: SyntheticScene, count: int, size: int, elevation: float = 20.0, start: float = -90.0
) -> tuple[Camera, ...]:
    """`count` cameras of `size`^2 pixels around the scene, at one height, looking at its center,
    as near as shows the scene's whole ball.

    Angles in degrees: `elevation` above the horizon, 45 of the picture, `start` the azimuth of
    the first camera (-90: the -y axis, before the demo's bear); the rest follow counter-clockwise.
    """
    center, up = torch.zeros(3, dtype=torch.float64), scene.up.to(torch.float64)
    east = torch.linalg.cross(perpendicular(up), up)  # the x axis where up is z
    return circle(
        center, scene.radius, up, count, size, elevation=elevation, fov=45.0, start=start, east=east
    )
