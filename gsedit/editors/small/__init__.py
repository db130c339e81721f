"""The learned editor: a small InstructPix2Pix, trained from scratch on a CPU.

examples/train_small made its weights. Each name is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsedit.editors.small.denoiser import DEFAULTS, Small, load_small, save_small
    from gsedit.editors.small.network import Architecture, SmallNetwork
    from gsedit.editors.small.shipped import REINSTALL, WEIGHTS

__all__ = [
    "DEFAULTS",
    "REINSTALL",
    "WEIGHTS",
    "Architecture",
    "Small",
    "SmallNetwork",
    "load_small",
    "save_small",
]

_MODULES = {
    "denoiser": ("DEFAULTS", "Small", "load_small", "save_small"),
    "network": ("Architecture", "SmallNetwork"),
    "shipped": ("REINSTALL", "WEIGHTS"),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """PEP 562: asking whether the weights are there loads no torch."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
