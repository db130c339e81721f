"""Surfaces of a scene as light finds them: normals and open sky. `n` Gaussians, `d` directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.cameras.place import Place
from gsedit.light.shadows import (
    SMALL_SKY,
    casters,
    lit_share,
    parallel_map,
    sky_directions,
)
from gsedit.scene.neighbors import nearest
from gsedit.surface.means import neighbor_means
from gsedit.surface.normals import estimate_normals
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

SKY_REACH = 0.5
"""Distance, in the radius, up to which something hides the sky: farther off, captures hold
ceilings and haze."""
OFFSET_PIXELS = 1.0
"""Distance above the surface, in pixels of a depth map, at which light is asked for."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Gaussians near the subject as light finds them, a row each."""

    points: Float[Tensor, "n 3"]
    """Centers in world units, float64."""
    normals: Float[Tensor, "n 3"]
    """Outward unit vectors, float64."""
    confidence: Float[Tensor, " n"]
    """Confidence of the normals, in [0, 1]."""
    near: Int[Tensor, "n k"]
    """Rows of the nearest neighbors."""
    directions: Float[Tensor, "d 3"]
    """Directions of the sky, unit vectors, float64."""
    open: Float[Tensor, "n d"]
    """Share of each direction's light that comes through, in [0, 1]."""
    occluders: Gaussians
    place: Place

    def smoothed(self, values: Float[Tensor, "n ..."], rounds: int = 2) -> Float[Tensor, "n ..."]:
        """Means over the nearest neighbors: single Gaussians know their place badly."""
        return neighbor_means(values, self.near, rounds)

    def facing(self, direction: Float[Tensor, "... 3"]) -> Float[Tensor, "n ..."]:
        """Cosine of light from unit vectors, at least 0; where a normal is not sure, that of a leaf
        of any direction, 1 / 4."""
        cosine = (self.normals @ direction.transpose(0, -1)).clamp_min(0)
        sure = self.confidence if direction.ndim == 1 else self.confidence[:, None]
        return sure * cosine + (1 - sure) / 4


def surface_of(
    scene: Gaussians, place: Place, cameras: Sequence[Camera], execution: Execution = AUTO
) -> Surface:
    """Normals of Gaussians and how much of the sky each sees."""
    normals = estimate_normals(scene, cameras, execution)
    unit = normals.directions.double()
    points = scene.means.detach().double()
    directions = sky_directions(place)
    occluders = casters(scene, place)
    lifted = points + OFFSET_PIXELS * 2 * place.radius / SMALL_SKY * unit
    columns = []
    for direction in directions:
        seen = parallel_map(occluders, place, direction, SMALL_SKY, execution)
        columns.append(lit_share(seen, lifted, SKY_REACH * place.radius))
    near = torch.from_numpy(nearest(scene.means.detach().float().numpy())[1])
    return Surface(
        points, unit, normals.confidence.double(), near, directions, torch.stack(columns, 1),
        occluders, place,
    )  # fmt: skip
