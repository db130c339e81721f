"""Close a surface: a solid's boundary through it, drawn anew on a grid.

Marching cubes give each edge to two faces whatever the distances are; a decimation would not.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, log2, sqrt

import numpy as np
from jaxtyping import Float32, Float64, Int64

from gsedit.mesh.triangles import Mesh, from_open3d, to_open3d
from gsedit.pictures.viewer.libraries import import_open3d, import_pyvista

FINEST = 10
"""Most halvings of the box that is solved for a smooth solid."""
MOST_POINTS = 30_000_000
"""Points of the grid: 120 MB for their distances."""
BLOCK = 8
"""Points along a side of a block: blocks without surface are not measured point by point."""
FACES_PER_SQUARE = 3.2
"""Triangles of marching cubes for a square of the grid's side of surface; 2 of a flat one."""
QUERIES = 1 << 20
"""Points measured at once."""
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
    depth = min(FINEST, max(5, ceil(log2(1.1 * extent / voxel))))
    found, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
    return from_open3d(found)


def _boundary(solid: Mesh, mesh: Mesh, side: float) -> Mesh:
    """The boundary of what is behind the solid's surface, in the mesh's box, with a margin."""
    low, high = mesh.vertices.min(0) - 2 * side, mesh.vertices.max(0) + 2 * side
    side = max(side, float(np.prod(high - low) / MOST_POINTS) ** (1 / 3))
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
    for some in np.array_split(near, max(1, len(near) * BLOCK**3 // QUERIES)):
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
