"""Fuse depth maps into signed distances on a sparse grid, and take the surface out of it.

Curless and Levoy 1996, by Open3D's voxel blocks: each view adds the distance along its rays, cut at
a few voxels, also what it sees to be free. So what only some views see in the air, others remove.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.mesh.triangles import Mesh, from_open3d
from gsedit.pictures.viewer.libraries import import_open3d
from gsedit.views.depth import SeenSurface

CUT_VOXELS = 6.0
"""Distance, in voxels, at which distances are cut: 2.7 standard deviations of a Gaussian, beyond
the noise of depth in 99 % of pixels."""
HAZE = 0.05
"""Standard deviation of a Gaussian, in the ball's radius, from which it may be a backdrop."""
BLOCK = 8
"""Voxels along a side of a block."""
MOST_BLOCKS = 60_000
"""Blocks of the grid: 250 MB, and 2.5 million triangles. A grid of more is made coarser."""
CLEAR = 0.1
"""Opacity below which a pixel tells that its ray meets nothing."""
BEYOND = 4.0
"""Depth of such a pixel, in the largest one of any surface: all of the grid is before it."""
LEAST_VIEWS = 3
"""Views that a voxel needs for a surface in it: two agree by chance."""


@dataclass(frozen=True, eq=False)
class Ball:
    """Part of the world that a mesh is made of."""

    center: Float[Tensor, "3"]
    radius: float
    usual: float = 0.0
    """Standard deviation of a Gaussian up to which it is no haze, however small the ball is."""

    def holds(
        self, points: Float[Tensor, "*b 3"], spread: Float[Tensor, "*b"]
    ) -> Bool[Tensor, "*b"]:
        """Whether points on Gaussians of these standard deviations are of a surface inside."""
        near = (points - self.center).norm(dim=-1) < self.radius
        return near & (spread < max(HAZE * self.radius, self.usual))


def fuse(surfaces: Sequence[SeenSurface], ball: Ball, voxel: float) -> tuple[Mesh, float]:
    """(the surface inside a ball, the voxels' side): `voxel`, or more where memory asks for it."""
    far = BEYOND * max(float(s.depth.max()) for s in surfaces) + ball.radius
    while True:
        grid = _grid(voxel)
        blocks = _blocks(grid, (_Frame.of(surface, ball, far) for surface in surfaces), far)
        if len(blocks) <= MOST_BLOCKS:
            break
        voxel *= 1.02 * sqrt(len(blocks) / MOST_BLOCKS)  # a surface has a square of them
    if not len(blocks):
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), voxel
    whole = _tensor(blocks, np.int32)
    for surface in surfaces:  # one at a time: they take the memory of the depths again, twice
        frame = _Frame.of(surface, ball, far)
        grid.integrate(whole, frame.free, frame.lens, frame.pose, 1.0, far, CUT_VOXELS)
    views = min(LEAST_VIEWS, len(surfaces))
    found = from_open3d(grid.extract_triangle_mesh(views - 0.5).to_legacy())
    return Mesh(found.vertices + ball.center.numpy(), found.faces), voxel


@dataclass(frozen=True, eq=False)
class _Frame:
    """A view as Open3D takes it, around the ball's center."""

    inside: Any
    """Depth of what is inside the ball; 0 elsewhere."""
    free: Any
    """Depth of all, and `far` where the ray meets nothing."""
    lens: Any
    pose: Any

    @classmethod
    def of(cls, surface: SeenSurface, ball: Ball, far: float) -> _Frame:
        camera, depth = surface.camera, surface.depth
        inside = depth * (ball.holds(surface.points, surface.spread) & surface.seen)
        clear = ~surface.seen & (surface.alpha < CLEAR)
        free = depth.masked_fill(clear, 0.99 * far)
        lens = [[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]]
        pose = camera.world_to_camera.detach().double().clone()
        pose[:3, 3] += pose[:3, :3] @ ball.center
        return cls(
            _image(inside), _image(free), _tensor(np.array(lens), np.float64),
            _tensor(pose.numpy(), np.float64),
        )  # fmt: skip


def _blocks(grid: Any, frames: Iterable[_Frame], far: float) -> Int[np.ndarray, "b 3"]:
    """The blocks near a surface that any view sees inside the ball."""
    found = [_touched(grid, frame, far) for frame in frames]
    return np.unique(np.concatenate(found), axis=0)


def _touched(grid: Any, frame: _Frame, far: float) -> Int[np.ndarray, "b 3"]:
    """The blocks near the surface that a view sees."""
    try:
        return grid.compute_unique_block_coordinates(
            frame.inside, frame.lens, frame.pose, 1.0, far, CUT_VOXELS
        ).numpy()
    except RuntimeError as error:
        if "No block is touched" not in str(error):  # one pixel in 16 is looked at
            raise
        return np.zeros((0, 3), np.int32)


def _grid(voxel: float) -> Any:
    open3d = import_open3d()
    kinds = (open3d.core.float32,) * 2
    return open3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), kinds, ((1), (1)), voxel, BLOCK, MOST_BLOCKS
    )


def _image(values: Float[Tensor, "h w"]) -> Any:
    return import_open3d().t.geometry.Image(_tensor(values.float().numpy(), np.float32))


def _tensor(values: np.ndarray, kind: type) -> Any:
    return import_open3d().core.Tensor(np.ascontiguousarray(values, kind))
