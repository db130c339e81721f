"""Points of a scene's surface, how sure their places are, and the lengths, heights, areas and
volumes between them, with the standard deviation that those of their points make.

World units, `n` Gaussians; errors of points are independent, alike in every direction, and small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, radians

import numpy as np
import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.planes import Plane
from gsedit.scene.table import table_of
from gsedit.toolkit.align import find_ground
from gsedit.views.dataset import evenly_spaced
from gsedit.views.depth import depth_at
from gsedit.views.depth import point_at as surface_at
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

WITHIN = 1.96
"""Standard deviations in an interval that holds 95 %."""
SMALL = 1e-6
"""Step of the derivatives, as a share of the size of what is measured."""


@dataclass(frozen=True)
class Size:
    """A measured size and its standard deviation."""

    value: float
    sigma: float
    power: int = 1
    """1 for a length, 2 for an area, 3 for a volume: how it grows with the scene's scale."""

    @property
    def interval(self) -> tuple[float, float]:
        """The interval that holds the true size in 95 of 100 cases."""
        return self.value - WITHIN * self.sigma, self.value + WITHIN * self.sigma

    def __str__(self) -> str:
        unit = ("", "unit", "square unit", "cubic unit")[self.power] + "s"
        digits = 3 if not self.sigma else max(0, 1 - int(np.floor(np.log10(WITHIN * self.sigma))))
        return f"{self.value:.{digits}f} ± {WITHIN * self.sigma:.{digits}f} {unit} (95 %)"


def distance(a: SurfacePoint, b: SurfacePoint) -> Size:
    """The distance of two points. Raises UsageError for points at one place."""
    if np.allclose(a.position, b.position):
        raise UsageError("the two points are one: name two places")
    return _size((a, b), lambda p: float(np.linalg.norm(p[1] - p[0])))


def height(point: SurfacePoint, ground: Plane, sigma: float = 0.0) -> Size:
    """The height of a point above the ground, whose own place has a standard deviation `sigma`."""
    found = _size((point,), lambda p: float(ground.heights(p)[0]))
    return Size(found.value, float(np.hypot(found.sigma, sigma)))


def area(corners: Sequence[SurfacePoint]) -> Size:
    """The area of a polygon, of one that is not flat the area of its shadow on its mean plane.

    Raises UsageError for fewer than three corners, or corners on a line.
    """
    if len(corners) < 3:
        raise UsageError("an area needs three corners or more, in order around it")
    found = _size(corners, _polygon)
    if found.value <= SMALL * max(float(np.ptp([c.position for c in corners])), 1e-30) ** 2:
        raise UsageError("the corners lie on a line: name them in order around the area")
    return Size(found.value, found.sigma, 2)


def volume(
    scene: Gaussians, cameras: Sequence[Camera] = (), inside: Bool[Tensor, " n"] | None = None
) -> Size:
    """The volume of the closed surface of some Gaussians (None: all); where nobody saw it, as
    `gsedit.mesh` closes it. Its deviation is the surface's area times a voxel's share.

    Raises UsageError where there is no surface.
    """
    from gsedit.mesh.build import mesh

    found = mesh(scene, cameras, inside=inside, watertight=True)
    solid = found.geometry
    edge = float(np.median(solid.edges_unique_length))
    return Size(abs(float(solid.volume)), float(solid.area) * edge / np.sqrt(12), 3)


def ground_of(scene: Gaussians, up: Float64[np.ndarray, "3"]) -> tuple[Plane, float]:
    """The ground of a scene, and how far the splats on it are from it (their standard deviation).

    `up` as `find_ground`. Raises UsageError where there is no ground.
    """
    table = table_of(scene)
    plane, share, _ = find_ground(table, up)
    away = np.abs(plane.heights(table.means))
    near = away[away <= np.quantile(away, max(share, 0.01))]
    return plane, float(np.sqrt(np.mean(near**2))) if len(near) else 0.0


def _size(
    points: Sequence[SurfacePoint], measured: Callable[[Float64[np.ndarray, "p 3"]], float]
) -> Size:
    """A size and its deviation to first order: that of each coordinate times the derivative."""
    at = np.stack([point.position for point in points])
    step = SMALL * max(float(np.abs(at - at.mean(0)).max()), float(np.abs(at).max()), 1e-30)
    variance = 0.0
    for row, point in enumerate(points):
        for axis in range(3):
            moved = at.copy()
            moved[row, axis] += step
            back = at.copy()
            back[row, axis] -= step
            slope = (measured(moved) - measured(back)) / (2 * step)
            variance += (slope * point.sigma) ** 2
    return Size(measured(at), float(np.sqrt(variance)))


def _polygon(corners: Float64[np.ndarray, "p 3"]) -> float:
    """The length of the vector area: that of the shadow on the mean plane."""
    around = corners - corners.mean(0)
    return float(np.linalg.norm(np.cross(around, np.roll(around, -1, 0)).sum(0))) / 2


ASKED_VIEWS = 16
"""Most other views that are asked for a point's place."""
SAME = 0.05
"""Share of the depth within which another view sees the same surface, and not one before it."""
FEWEST = 3
"""Other views that must see a point to tell how far the views disagree about it."""
ALONE = 0.01
"""Share of the depth that a point is unsure by where fewer views see it."""
OBLIQUE = 40.0
"""Degrees between the rays of two views that are compared."""
NORMAL = 1.4826
"""Standard deviations in a median of absolute deviations, of a normal distribution."""


@dataclass(frozen=True, eq=False)
class SurfacePoint:
    """A point, and the standard deviation of its place in every direction alike."""

    position: Float64[np.ndarray, "3"]
    sigma: float = 0.0
    """0 for a point that is given by its coordinates."""
    views: int = 0
    """Number of other views that see it."""


@torch.no_grad()
def point_at(
    scene: Gaussians, camera: Camera, x: float, y: float, others: Sequence[Camera] = ()
) -> SurfacePoint:
    """The point of the surface that a pixel shows: where the median of its ray's opacity lies.

    Its standard deviation joins two: a place somewhere in the pixel, and how far the depths of
    those of the `others` that see the point disagree with it.
    Raises UsageError for a pixel beside the picture, or on nothing.
    """
    position = surface_at(scene, camera, x, y)
    depth = float(camera.project(position[None])[1])
    apart = [each for each in others if _looks_alike(each, camera, position)]
    errors = [_disagreement(scene, each, position) for each in apart]
    errors = [each for each in errors if each is not None]
    if len(errors) > ASKED_VIEWS:
        errors = [errors[i] for i in evenly_spaced(len(errors), ASKED_VIEWS)]
    told = NORMAL * float(np.median(np.abs(errors))) if len(errors) >= FEWEST else ALONE * depth
    # 12**-0.5: deviation of a place somewhere in a pixel
    sigma = float(np.hypot(told, 12**-0.5 * depth / float(camera.fx)))
    return SurfacePoint(position.numpy(), sigma, len(errors))


def _looks_alike(other: Camera, camera: Camera, position: torch.Tensor) -> bool:
    """Whether another camera looks at a point from another place, at most OBLIQUE away: from
    farther round, depths are told along the surface rather than across it."""
    rays = [(position - each.center.double()) for each in (other, camera)]
    cosine = float(torch.nn.functional.cosine_similarity(*rays, dim=0))
    return cos(radians(OBLIQUE)) < cosine < 1 - 1e-9


def _disagreement(scene: Gaussians, camera: Camera, position: torch.Tensor) -> float | None:
    """Depth at which another view has a point, less the point's own; None where it does not see
    it."""
    (x, y), depth, inside = camera.pictured(position)
    if not inside:
        return None
    seen, z = depth_at(scene, camera, float(x), float(y)), float(depth)
    return seen - z if seen > 0 and abs(seen - z) <= SAME * z else None
