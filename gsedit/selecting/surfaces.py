"""Gaussians of a scene with what tells one object from another: normals, heights, neighbors.

`n` Gaussians; world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int
from scipy.sparse import coo_matrix

from gsedit.cameras.around import cameras_of
from gsedit.datasets.dataset import evenly_spaced
from gsedit.light.place import Place, place_of
from gsedit.regions.graph import Neighbors, nearest_of, neighbors
from gsedit.surface.normals import estimate_normals
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.numerics import AUTO, Execution, sh_to_color
from rasterizer.scene import Gaussians

VIEWS = 8
"""Most views that the surfaces are looked at from."""
VIEW_PIXELS = 192
"""Longer side of their pictures."""
SOLID_OPACITY = 0.1
"""Gaussians fainter than this connect nothing."""
LARGE = 6.0
"""Gaussians this many times as long as is usual connect nothing: haze and sky."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The Gaussians of a scene as pieces of surfaces."""

    scene: Gaussians
    place: Place
    """Upright axes, and the middle of what the cameras look at."""
    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    """Unit vectors that point outward."""
    colors: Float64[np.ndarray, "n 3"]
    """sRGB in [0, 1], without view dependence."""
    seen: Float64[np.ndarray, " n"]
    """Pixels that the Gaussian gives, over all looked-at views."""
    solid: Bool[np.ndarray, " n"]
    """Whether it is opaque and small enough to connect others."""
    graph: Neighbors
    view: int = 0
    """Index of the camera that looks most along the place's front."""

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def up(self) -> Float64[np.ndarray, "3"]:
        """Unit vector that points upward."""
        return self.place.up.numpy()

    @cached_property
    def heights(self) -> Float64[np.ndarray, " n"]:
        """Heights of the centers along `up`, from the world's origin."""
        return self.points @ self.up

    @cached_property
    def upright(self) -> Float64[np.ndarray, " n"]:
        """Cosine between normal and up: 1 on level ground."""
        return self.normals @ self.up

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of neighbors that are both solid, the lower row first."""
        upper = coo_matrix(self.graph.affinity)
        keep = (upper.row < upper.col) & self.solid[upper.row] & self.solid[upper.col]
        return np.stack((upper.row[keep], upper.col[keep]), 1).astype(np.int64)

    @cached_property
    def alike(self) -> Float64[np.ndarray, " e"]:
        """Affinity of each of the edges, in [0, 1]."""
        pairs = self.edges
        return np.asarray(self.graph.affinity[pairs[:, 0], pairs[:, 1]]).reshape(-1)

    @cached_property
    def areas(self) -> Float64[np.ndarray, " n"]:
        """Share of a surface that a Gaussian stands for: the square of its neighbors' distance."""
        pairs = self.edges
        square = np.square(self.points[pairs[:, 0]] - self.points[pairs[:, 1]]).sum(1)
        total, count = np.zeros(len(self)), np.zeros(len(self))
        for column in pairs.T:
            np.add.at(total, column, square)
            np.add.at(count, column, 1)
        return total / np.maximum(count, 1)


@torch.no_grad()
def look(scene: Gaussians, cameras: Sequence[Camera] = (), execution: Execution = AUTO) -> Surfaces:
    """Look at a scene's surfaces from at most VIEWS of the cameras; found ones where none are.

    Raises UsageError for an empty scene.
    """
    some = cameras_of(scene, cameras, VIEWS, VIEW_PIXELS)
    chosen = [some[i].fitted(VIEW_PIXELS) for i in evenly_spaced(len(some), VIEWS)]
    seen = torch.zeros(len(scene))
    for camera in chosen:
        ones = torch.ones(camera.height, camera.width, 3)
        seen += color_weights(scene, camera, execution=execution).back(ones)[:, 0]
    near = nearest_of(scene)
    normals = estimate_normals(scene, chosen, execution, near=torch.from_numpy(near[1])).directions
    longest = scene.scales.amax(1)
    solid = (scene.opacities > SOLID_OPACITY) & (longest < LARGE * longest[seen > 0].median())
    place = place_of(scene, some, seen)
    ahead = torch.stack([camera.forward.double() for camera in some])
    return Surfaces(
        scene,
        place,
        scene.means.double().numpy(),
        normals.double().numpy(),
        sh_to_color(scene.sh[:, 0].double()).clamp(0, 1).numpy(),
        seen.double().numpy(),
        solid.numpy(),
        neighbors(scene, normals, near),
        int((ahead @ -place.front).argmax()),
    )
