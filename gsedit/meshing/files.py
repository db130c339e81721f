"""Write meshes: .glb, .ply, .obj and .stl, by trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsedit.errors import UsageError
from gsedit.formats.axes import LUF, axes_matrix
from gsedit.meshing.triangles import Mesh
from gsedit.scene.color_space import linear_of_srgb
from gsedit.storage.atomic import atomic_path

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
