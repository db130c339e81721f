"""Points of a scene's surface, and how sure their places are.

`n` Gaussians; positions and standard deviations in world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians

import numpy as np
import torch
from jaxtyping import Float64

from gsedit.datasets.dataset import evenly_spaced
from gsedit.errors import UsageError
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

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
PIXEL = 12**-0.5
"""Standard deviation of a place somewhere in a pixel, pixels."""


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
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        size = f"{camera.width}x{camera.height}"
        raise UsageError(f"{x:g},{y:g} is outside of the picture, which has {size} pixels")
    depth = _depth(scene, camera, x, y)
    if depth <= 0:
        raise UsageError(f"nothing is seen at {x:g},{y:g}: choose a pixel on a surface")
    pixel = torch.tensor([x, y], dtype=torch.float64)
    position = camera.unproject(pixel, torch.tensor(depth, dtype=torch.float64)).double()
    apart = [each for each in others if _looks_alike(each, camera, position)]
    errors = [_disagreement(scene, each, position) for each in apart]
    errors = [each for each in errors if each is not None]
    if len(errors) > ASKED_VIEWS:
        errors = [errors[i] for i in evenly_spaced(len(errors), ASKED_VIEWS)]
    told = NORMAL * float(np.median(np.abs(errors))) if len(errors) >= FEWEST else ALONE * depth
    sigma = float(np.hypot(told, PIXEL * depth / float(camera.fx)))
    return SurfacePoint(position.numpy(), sigma, len(errors))


def _looks_alike(other: Camera, camera: Camera, position: torch.Tensor) -> bool:
    """Whether another camera looks at a point from another place, at most OBLIQUE away: from
    farther round, depths are told along the surface rather than across it."""
    rays = [(position - each.center.double()) for each in (other, camera)]
    cosine = float(torch.nn.functional.cosine_similarity(*rays, dim=0))
    return cos(radians(OBLIQUE)) < cosine < 1 - 1e-9


def _depth(scene: Gaussians, camera: Camera, x: float, y: float) -> float:
    """Median depth at a pixel; 0 where nothing is."""
    box = (min(int(x), camera.width - 1), min(int(y), camera.height - 1), 1, 1)
    drawn = render(scene, camera, crop=box, median_depth=True).median_depth
    assert drawn is not None  # it was asked for
    return float(drawn)


def _disagreement(scene: Gaussians, camera: Camera, position: torch.Tensor) -> float | None:
    """Depth at which another view has a point, less the point's own; None where it does not see
    it."""
    xy, depth = camera.project(position[None])
    x, y, z = float(xy[0, 0]), float(xy[0, 1]), float(depth[0])
    if z <= 0 or not (0 <= x < camera.width and 0 <= y < camera.height):
        return None
    seen = _depth(scene, camera, x, y)
    return seen - z if seen > 0 and abs(seen - z) <= SAME * z else None
