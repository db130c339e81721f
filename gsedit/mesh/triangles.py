"""Triangle meshes in memory and in files. `v` vertices, `f` faces; world units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from gsedit.errors import UsageError
from gsedit.formats.axes import LUF, axes_matrix
from gsedit.pictures.viewer.libraries import import_open3d
from gsedit.run.atomic import atomic_path
from gsedit.scene.color_space import linear_of_srgb


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with a color at each vertex; counter-clockwise where seen from outside."""

    vertices: Float64[np.ndarray, "v 3"]
    faces: Int64[np.ndarray, "f 3"]
    colors: Float64[np.ndarray, "v 3"] | None = None
    """sRGB in [0, 1]."""
    notes: tuple[str, ...] = ()
    """Remarks for a person."""

    def __repr__(self) -> str:
        closed = "closed" if self.is_closed else "open"
        return f"Mesh({len(self.vertices):,} vertices, {len(self.faces):,} faces, {closed})"

    @cached_property
    def geometry(self) -> Any:
        """The vertices and faces as trimesh's Trimesh."""
        from trimesh import Trimesh

        return Trimesh(self.vertices, self.faces, process=False)

    @property
    def areas(self) -> Float64[np.ndarray, " f"]:
        """Areas of the faces."""
        return self.geometry.area_faces

    @property
    def normals(self) -> Float64[np.ndarray, "v 3"]:
        """Outward unit normals of the vertices: means of their faces'."""
        return np.array(self.geometry.vertex_normals)

    @property
    def volume(self) -> float:
        """Volume that a closed mesh encloses, cubed world units; negative if inside out."""
        return float(self.geometry.volume)

    @property
    def is_closed(self) -> bool:
        """Whether each edge is of exactly two faces, which run along it in opposite ways."""
        return bool(self.geometry.is_watertight and self.geometry.is_winding_consistent)

    @property
    def components(self) -> Int64[np.ndarray, " f"]:
        """Number, from 0, of the connected part that each face is of."""
        from trimesh.graph import connected_component_labels

        labels = connected_component_labels(self.geometry.edges_unique, len(self.vertices))
        return labels[self.faces[:, 0]].astype(np.int64)

    def kept(self, faces: Bool[np.ndarray, " f"]) -> Mesh:
        """The mesh of some of the faces, without vertices that are of none."""
        rows, inverse = np.unique(self.faces[faces], return_inverse=True)
        colors = None if self.colors is None else self.colors[rows]
        return replace(
            self, vertices=self.vertices[rows], faces=inverse.reshape(-1, 3), colors=colors
        )


def to_open3d(mesh: Mesh) -> Any:
    """The vertices and faces as Open3D's TriangleMesh."""
    open3d = import_open3d()
    vectors = open3d.utility
    return open3d.geometry.TriangleMesh(
        vectors.Vector3dVector(mesh.vertices), vectors.Vector3iVector(mesh.faces.astype(np.int32))
    )


def from_open3d(triangles: Any) -> Mesh:
    """Vertices and faces of Open3D's TriangleMesh."""
    vertices = np.asarray(triangles.vertices, np.float64).reshape(-1, 3)
    return Mesh(vertices, np.asarray(triangles.triangles, np.int64).reshape(-1, 3))


SUFFIXES = (".glb", ".ply", ".obj", ".stl")
"""Endings of the files that can be written."""


def save_mesh(mesh: Mesh, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a mesh; the ending says how: .glb, .ply, .obj, or .stl, which holds no colors.

    Units are those of the scene, and so are the axes, but those of .glb, whose +y is up: the way
    splats are written into glTF. Its colors are linear light, all other ones sRGB. Raises
    UsageError for another ending, or a file that exists (and not `overwrite`).
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: name a mesh file: {', '.join(SUFFIXES)}")
    from trimesh import Trimesh

    gltf = path.suffix.lower() == ".glb"
    vertices, colors = mesh.vertices, mesh.colors
    if gltf:
        vertices = vertices @ axes_matrix(LUF)  # its inverse is its transpose
        colors = None if colors is None else linear_of_srgb(colors)
    levels = None if colors is None else np.round(np.clip(colors, 0, 1) * 255).astype(np.uint8)
    made = Trimesh(vertices, mesh.faces, vertex_colors=levels, process=False)
    with atomic_path(path, overwrite=overwrite) as temporary:
        made.export(str(temporary), file_type=path.suffix.lower()[1:])
