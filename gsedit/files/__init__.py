"""Scenes and datasets in files; each name is imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.files.atomic import atomic_path
    from gsedit.files.datasets import load_dataset
    from gsedit.files.ply import PlyFile, read_ply
    from gsedit.files.scenes import SceneFile, load, read_scene, save

__all__ = [
    "PlyFile",
    "SceneFile",
    "atomic_path",
    "load",
    "load_dataset",
    "read_ply",
    "read_scene",
    "save",
]

make_lazy(
    __name__,
    {
        "atomic": ("atomic_path",),
        "datasets": ("load_dataset",),
        "ply": ("PlyFile", "read_ply"),
        "scenes": ("SceneFile", "load", "read_scene", "save"),
    },
)
