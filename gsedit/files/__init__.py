"""Scenes and datasets in files; each name is imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

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

_HOMES = {
    "atomic_path": "atomic",
    "load_dataset": "datasets",
    "PlyFile": "ply",
    "read_ply": "ply",
    "SceneFile": "scenes",
    "load": "scenes",
    "read_scene": "scenes",
    "save": "scenes",
}


def __getattr__(name: str) -> Any:
    """PEP 562: `import gsedit.files` itself loads neither torch nor NumPy."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
