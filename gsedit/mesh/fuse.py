"""Fuse depth maps into signed distances on a sparse grid, and take the surface out of it.

Curless and Levoy 1996, by Open3D's voxel blocks: each view adds the distance along its rays, cut at
a few voxels, also what it sees to be free. So what only some views see in the air, others remove.

Then close it: a solid's boundary through it, drawn anew on a grid. Marching cubes give each edge to
two faces whatever the distances are; a decimation would not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import ceil, log2, sqrt
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int64
from torch import Tensor

from gsedit.mesh.triangles import Mesh, from_open3d, to_open3d
from gsedit.pictures.viewer.libraries import import_open3d, import_pyvista
from gsedit.views.depth import SeenSurface

CUT_VOXELS = 6.0
"""Distance, in voxels, at which distances are cut: 2.7 standard deviations of a Gaussian, beyond
the noise of depth in 99 % of pixels."""
BLOCK = 8
"""Voxels, and points, along a side of a block: what has no surface is not measured point by point.
"""
MOST_BLOCKS = 60_000
"""Blocks of the grid: 250 MB, and 2.5 million triangles. A grid of more is made coarser."""
CLEAR = 0.1
"""Opacity below which a pixel tells that its ray meets nothing."""


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
        return near & (spread < max(0.05 * self.radius, self.usual))


def fuse(surfaces: Sequence[SeenSurface], ball: Ball, voxel: float) -> tuple[Mesh, float]:
    """(the surface inside a ball, the voxels' side): `voxel`, or more where memory asks for it."""
    # a pixel without a surface lies behind all of the grid
    far = 4.0 * max(float(s.depth.max()) for s in surfaces) + ball.radius
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
    views = min(3, len(surfaces))  # two agree by chance
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


FACES_PER_SQUARE = 3.2
"""Triangles of marching cubes for a square of the grid's side of surface; 2 of a flat one."""
Signed = Callable[[Float64[np.ndarray, "p 3"]], Float32[np.ndarray, " p"]]
"""A map from points to their signed distances from a surface."""


def closed(mesh: Mesh, voxel: float, faces: int) -> Mesh:
    """A closed surface near a mesh, of at most `faces` faces, no finer than the voxels.

    A screened Poisson reconstruction (Kazhdan 2013) spans what nobody saw; where it leaves its box
    it is cut and capped.
    """
    solid = _solid(mesh, voxel)
    side = max(voxel, sqrt(FACES_PER_SQUARE * float(solid.areas.sum()) / faces))
    while True:
        found = _boundary(solid, mesh, side)
        if len(found.faces) <= faces:
            return found
        side *= 1.02 * sqrt(len(found.faces) / faces)


def _solid(mesh: Mesh, voxel: float) -> Mesh:
    """The reconstructed surface, open at its box where the mesh goes on to there."""
    open3d = import_open3d()
    vectors = open3d.utility.Vector3dVector
    cloud = open3d.geometry.PointCloud(vectors(mesh.vertices))
    cloud.normals = vectors(mesh.normals)
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    depth = min(10, max(5, ceil(log2(1.1 * extent / voxel))))
    found, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
    return from_open3d(found)


def _boundary(solid: Mesh, mesh: Mesh, side: float) -> Mesh:
    """The boundary of what is behind the solid's surface, in the mesh's box, with a margin."""
    low, high = mesh.vertices.min(0) - 2 * side, mesh.vertices.max(0) + 2 * side
    side = max(side, float(np.prod(high - low) / 30_000_000) ** (1 / 3))  # 120 MB of distances
    blocks = np.ceil((high - low) / (side * BLOCK)).astype(int)
    distances = _distances(_signed(solid), low, side, blocks)
    for axis in range(3):  # outside of the box nothing is solid
        np.moveaxis(distances, axis, 0)[[0, -1]] = side
    grid = import_pyvista().ImageData(
        dimensions=distances.shape, spacing=(side,) * 3, origin=tuple(low)
    )
    cut = grid.contour([0.0], scalars=distances.ravel(order="F"), method="marching_cubes")
    faces = np.asarray(cut.faces, np.int64).reshape(-1, 4)[:, 1:]
    found = Mesh(np.asarray(cut.points, np.float64), faces)
    return found if found.volume >= 0 else Mesh(found.vertices, faces[:, ::-1])


def _distances(
    signed: Signed, low: Float64[np.ndarray, "3"], side: float, blocks: Int64[np.ndarray, "3"]
) -> Float32[np.ndarray, "x y z"]:
    """Signed distances on a grid from `low`; exact near the surface, of the right sign elsewhere,
    and never 0."""
    corners = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), -1).reshape(-1, 3)
    middles = signed(low + side * (BLOCK * corners + (BLOCK - 1) / 2))
    result = np.repeat(middles[:, None], BLOCK**3, 1)
    near = np.flatnonzero(np.abs(middles) < sqrt(3) * BLOCK * side)
    inner = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for some in np.array_split(near, max(1, len(near) * BLOCK**3 // (1 << 20))):  # points at once
        points = low + side * (BLOCK * corners[some, None] + inner)
        result[some] = signed(points.reshape(-1, 3)).reshape(-1, BLOCK**3)
    result[np.abs(result) < 1e-4 * side] = 1e-4 * side  # a corner on the surface: flat triangles
    cube = result.reshape(*blocks, BLOCK, BLOCK, BLOCK)
    return cube.transpose(0, 3, 1, 4, 2, 5).reshape(blocks * BLOCK)


def _signed(mesh: Mesh) -> Signed:
    """Signed distances from a surface, negative behind it: by the normal where it is nearest."""
    open3d, normals = import_open3d(), mesh.normals
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(to_open3d(mesh)))

    def distances(points: Float64[np.ndarray, "p 3"]) -> Float32[np.ndarray, " p"]:
        places = points.astype(np.float32)
        found = scene.compute_closest_points(open3d.core.Tensor(places))
        away = places - found["points"].numpy()
        corners = mesh.faces[found["primitive_ids"].numpy().astype(np.int64)]
        uv = found["primitive_uvs"].numpy()
        weights = np.column_stack((1 - uv.sum(1), uv))
        facing = (normals[corners] * weights[:, :, None]).sum(1)
        behind = (away * facing).sum(1) < 0
        return (np.linalg.norm(away, axis=1) * np.where(behind, -1, 1)).astype(np.float32)

    return distances
