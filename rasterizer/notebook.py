"""How a notebook shows a scene: a picture, drawn by a function that another package names.

The renderer does not choose where a scene is looked at from; whoever does, names its function here.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_drawn_by: str | None = None


def draw_scenes_with(reference: str) -> None:
    """Name the function, as "module:function", that makes the bytes of a PNG from a scene. It is
    imported when a notebook shows the first one."""
    global _drawn_by
    _drawn_by = reference


def scene_png(scene: Any) -> bytes | None:
    """The scene's picture; None where no function is named or it fails: a notebook then shows the
    text."""
    if _drawn_by is None:
        return None
    module, _, name = _drawn_by.partition(":")
    try:
        return getattr(import_module(module), name)(scene)
    except Exception:
        return None
