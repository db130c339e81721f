"""2D editors by name; each name here is imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsedit.editors.protocol import Capabilities, Denoiser, EditBatch, Editor, EditProgress
    from gsedit.editors.registry import EDITORS, Listing, editor_names, list_editors, make_editor

__all__ = [
    "EDITORS",
    "Capabilities",
    "Denoiser",
    "EditBatch",
    "EditProgress",
    "Editor",
    "Listing",
    "editor_names",
    "list_editors",
    "make_editor",
]

_MODULES = {
    "protocol": ("Capabilities", "Denoiser", "EditBatch", "EditProgress", "Editor"),
    "registry": ("EDITORS", "Listing", "editor_names", "list_editors", "make_editor"),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """PEP 562: `import gsedit.editors` itself loads no torch."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
