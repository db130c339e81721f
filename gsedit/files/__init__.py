"""Scenes and datasets in files; each name is imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.files.atomic import atomic_path
    from gsedit.files.datasets import load_dataset
    from gsedit.files.formats import open_scene, write_scene
    from gsedit.files.ply import PlyFile, read_ply
    from gsedit.files.scenes import SceneFile, load, read_scene, save
    from gsedit.files.streams import ReadOptions, SceneHeader, SceneSource, WriteOptions
    from gsedit.files.table import SplatTable, gaussians_of, table_of

__all__ = [
    "PlyFile",
    "ReadOptions",
    "SceneFile",
    "SceneHeader",
    "SceneSource",
    "SplatTable",
    "WriteOptions",
    "atomic_path",
    "gaussians_of",
    "load",
    "load_dataset",
    "open_scene",
    "read_ply",
    "read_scene",
    "save",
    "table_of",
    "write_scene",
]

make_lazy(
    __name__,
    {
        "atomic": ("atomic_path",),
        "datasets": ("load_dataset",),
        "formats": ("open_scene", "write_scene"),
        "ply": ("PlyFile", "read_ply"),
        "scenes": ("SceneFile", "load", "read_scene", "save"),
        "streams": ("ReadOptions", "SceneHeader", "SceneSource", "WriteOptions"),
        "table": ("SplatTable", "gaussians_of", "table_of"),
    },
)
