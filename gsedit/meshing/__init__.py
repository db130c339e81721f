"""Triangles of the surfaces of a scene: fused depth, tidied, closed, colored, written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.meshing.build import mesh
    from gsedit.meshing.triangles import Mesh, save_mesh

make_lazy(__name__)
