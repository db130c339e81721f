"""Meshes of the surfaces of a scene; lengths, areas and volumes with their intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.mesh.build import mesh
    from gsedit.mesh.triangles import Mesh, save_mesh

make_lazy(__name__)
