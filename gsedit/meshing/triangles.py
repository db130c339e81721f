"""Triangle meshes in memory. `v` vertices, `f` faces; world units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gsedit.pictures.viewer.libraries import import_open3d


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

    @property
    def corners(self) -> Float64[np.ndarray, "f 3 3"]:
        """Positions of the three corners of each face."""
        return self.vertices[self.faces]

    @property
    def areas(self) -> Float64[np.ndarray, " f"]:
        """Areas of the faces."""
        return np.linalg.norm(self._crosses, axis=1) / 2

    @property
    def normals(self) -> Float64[np.ndarray, "v 3"]:
        """Outward unit normals of the vertices: means of their faces', by area."""
        total = np.zeros_like(self.vertices)
        crosses = self._crosses
        for corner in self.faces.T:
            for axis in range(3):
                total[:, axis] += np.bincount(corner, crosses[:, axis], len(total))
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)

    @property
    def volume(self) -> float:
        """Volume that a closed mesh encloses, cubed world units; negative if inside out."""
        a, b, c = np.moveaxis(self.corners - self.vertices.mean(0), 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)

    @property
    def is_closed(self) -> bool:
        """Whether each edge is of exactly two faces, which run along it in opposite ways."""
        a, b = self.faces, np.roll(self.faces, -1, axis=1)
        ahead = np.sort((a * len(self.vertices) + b).ravel())
        back = np.sort((b * len(self.vertices) + a).ravel())
        return len(ahead) > 0 and np.array_equal(ahead, back) and bool((np.diff(ahead) > 0).all())

    @property
    def components(self) -> Int64[np.ndarray, " f"]:
        """Number, from 0, of the connected part that each face is of."""
        a, b = self.faces[:, :2].T, self.faces[:, 1:].T
        rows, columns = np.concatenate((a[0], b[0])), np.concatenate((a[1], b[1]))
        shape = (len(self.vertices),) * 2
        graph = coo_matrix((np.ones(len(rows), bool), (rows, columns)), shape)
        return connected_components(graph, directed=False)[1][self.faces[:, 0]].astype(np.int64)

    def kept(self, faces: Bool[np.ndarray, " f"]) -> Mesh:
        """The mesh of some of the faces, without vertices that are of none."""
        rows, inverse = np.unique(self.faces[faces], return_inverse=True)
        colors = None if self.colors is None else self.colors[rows]
        return replace(
            self, vertices=self.vertices[rows], faces=inverse.reshape(-1, 3), colors=colors
        )

    @property
    def _crosses(self) -> Float64[np.ndarray, "f 3"]:
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a)


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
