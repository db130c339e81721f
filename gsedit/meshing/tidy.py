"""Make a fused surface a mesh to hand on: without crumbs, smooth, of fewer faces, closed."""

from __future__ import annotations

from math import ceil, log2

import numpy as np
from jaxtyping import Float64

from gsedit.meshing.triangles import Mesh, from_open3d, to_open3d

CRUMB = 0.01
"""Area of a part, in that of the largest one, below which it is dropped: floaters."""
ROUNDS = 5
"""Rounds of Taubin's smoothing, which keeps volumes: noise of single voxels goes."""
FINEST = 10
"""Most halvings of the closing surface's box."""


def without_crumbs(mesh: Mesh) -> Mesh:
    """The mesh without the parts that are small beside its largest one."""
    if not len(mesh.faces):
        return mesh
    part = mesh.components
    area = np.bincount(part, mesh.areas)
    return mesh.kept(area[part] >= CRUMB * area.max())


def smoothed(mesh: Mesh) -> Mesh:
    """The mesh after Taubin's smoothing (1995)."""
    return from_open3d(to_open3d(mesh).filter_smooth_taubin(ROUNDS))


def decimated(mesh: Mesh, faces: int) -> Mesh:
    """The mesh with at most `faces` faces, by quadric errors (Garland and Heckbert 1997)."""
    if len(mesh.faces) <= faces:
        return mesh
    return from_open3d(to_open3d(mesh).simplify_quadric_decimation(faces))


def closed(mesh: Mesh, voxel: float) -> Mesh:
    """A closed surface through the vertices: screened Poisson reconstruction (Kazhdan 2013), at
    about the voxels' size."""
    from open3d.geometry import PointCloud, TriangleMesh
    from open3d.utility import Vector3dVector

    cloud = PointCloud(Vector3dVector(mesh.vertices))
    cloud.normals = Vector3dVector(mesh.normals)
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    depth = min(FINEST, max(5, ceil(log2(1.1 * extent / voxel))))
    found, _ = TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
    return from_open3d(found)


def diagonal(vertices: Float64[np.ndarray, "v 3"]) -> float:
    """Diagonal of the box around vertices."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))
