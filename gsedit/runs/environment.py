"""Versions and threads, which decide a result beside the request, and packages to load."""

from __future__ import annotations

import platform
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from gsedit.errors import GseditError

PACKAGES = ("gsedit", "torch", "numpy", "kornia")


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


def installed_version(package: str) -> str | None:
    """The installed version of a package; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
