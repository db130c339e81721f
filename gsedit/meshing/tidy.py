"""Make a fused surface a mesh to hand on: without crumbs, smooth, of fewer faces."""

from __future__ import annotations

import numpy as np

from gsedit.meshing.triangles import Mesh, from_open3d, to_open3d

CRUMB = 0.01
"""Area of a part, in that of the largest one, below which it is dropped: floaters."""
ROUNDS = 5
"""Rounds of Taubin's smoothing, which keeps volumes: noise of single voxels goes."""


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
