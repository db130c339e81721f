"""Selections by a closed mesh: the Gaussians whose centers are inside, by Open3D's ray casting."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import GseditError, InputError
from gsedit.runs.environment import load_extra
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.storage.inputs import existing_file
from gsedit.toolkit.selection.base import Selection

RAYS = 3
"""A point, of which the majority counts: one ray may pass through an edge."""


@dataclass(frozen=True)
class InsideMesh(Selection):
    """Select the inside of a closed surface in the coordinates of the scene: .obj, .ply, .stl,
    .off, .glb or .gltf."""

    path: Path

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        file = existing_file(self.path)
        open3d = _library()
        casting, low, high = _casting(file, file.stat().st_mtime_ns)
        near = ((table.means >= low) & (table.means <= high)).all(1)  # and no NaN
        points = open3d.core.Tensor.from_numpy(np.ascontiguousarray(table.means[near]))
        inside = np.zeros(len(table), bool)
        inside[near] = casting.compute_occupancy(points, nsamples=RAYS).numpy() > 0.5
        return inside


@lru_cache(maxsize=4)
def _casting(path: Path, changed: int) -> tuple[Any, Any, Any]:
    """The scene to cast rays in and the mesh's bounds. Raises InputError for no closed mesh."""
    import trimesh

    from gsedit.formats.mesh_files import geometries

    open3d = _library()
    try:
        parts = [part for part in geometries(path) if hasattr(part, "faces")]
        mesh: Any = trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)  # they are repeated along seams
    except (GseditError, MemoryError):
        raise
    except Exception as error:  # its readers raise a dozen kinds
        reason = str(error).split("\n")[0]
        raise InputError(
            f"{path} is no mesh that can be read ({reason}): give .obj, .ply, .stl, .off or .glb"
        ) from None
    if not len(mesh.faces):
        raise InputError(f"{path} has no triangles: give a mesh as .obj, .ply, .stl, .off or .glb")
    if not mesh.is_watertight:
        raise InputError(
            f"{path} is no closed mesh (an edge does not belong to two triangles), so it has no "
            "inside: close its holes first"
        )
    casting = open3d.t.geometry.RaycastingScene()
    casting.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    low, high = mesh.bounds
    return casting, low, high


def _library() -> Any:
    return load_extra("open3d", "a selection by a mesh")
