"""Versions and threads, which decide a result beside the request."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

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


def installed_version(package: str) -> str | None:
    """The installed version of a package; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
