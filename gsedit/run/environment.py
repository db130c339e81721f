"""Versions and threads, which decide a result beside the request, and packages to load."""

from __future__ import annotations

import platform
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from gsedit.errors import GseditError

PACKAGES = ("gsedit", "torch", "numpy", "kornia")
EXTRAS = {
    "OpenEXR": "exr",
    "av": "video",
    "matplotlib": "plots",
    "mcp": "mcp",
    "open3d": "mesh",
    "pyvista": "points",
}
"""The extra of gsedit that brings a package."""
SYSTEM = {"open3d": "libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0"}
"""Packages of Debian that a package loads."""


def environment() -> dict[str, Any]:
    """Versions, platform and torch's number of threads, ready for JSON."""
    import torch

    return {
        "versions": {name: installed_version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": torch.get_num_threads(),
    }


def load_package(name: str, what: str, move: str) -> Any:
    """Import a package that only a part of gsedit needs.

    Raises GseditError, with `what` needs it and the next `move`, where that fails.
    """
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        raise GseditError(f"{what} ({error}): {move}") from error


def load_extra(name: str, what: str, instead: str = "") -> Any:
    """Import a package, or a module of it, that an extra of gsedit brings.

    Raises GseditError, with `what` needs it, where that fails; `instead`: what does without it.
    """
    package = name.partition(".")[0]
    move = f"pip install 'gsedit[{EXTRAS[package]}]'"
    if package in SYSTEM:
        move += f", and on Debian apt-get install -y {SYSTEM[package]}"
    return load_package(name, f"{what} needs {package}", f"{move}{instead and ', or '}{instead}")


def installed_version(package: str) -> str | None:
    """The installed version of a package; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
