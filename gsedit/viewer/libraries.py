"""The libraries of the viewers: loaded when they are used, refused with what to install."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from typing import Any

from gsedit.errors import GseditError


def import_open3d() -> Any:
    """The module open3d. Raises GseditError where it cannot be loaded."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise GseditError(
            f"open3d cannot be loaded ({error}); try: pip install open3d-cpu, and on Debian "
            "apt-get install -y libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0"
        ) from error
    return open3d


def import_pyvista() -> Any:
    """The module pyvista. Raises GseditError where it cannot be loaded."""
    if not has_screen():  # must be set before VTK is loaded: without it VTK wants an X server
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista
    except (ImportError, OSError) as error:
        raise GseditError(
            f"pyvista cannot be loaded ({error}); try: pip install pyvista"
        ) from error
    return pyvista


def import_trimesh() -> Any:
    """The module trimesh. Raises GseditError where it cannot be loaded."""
    try:
        import trimesh
    except (ImportError, OSError) as error:
        raise GseditError(
            f"trimesh cannot be loaded ({error}); try: pip install trimesh"
        ) from error
    return trimesh


def import_viser() -> Any:
    """The module viser. Raises GseditError where it cannot be loaded."""
    try:
        import viser
    except (ImportError, OSError) as error:
        raise GseditError(
            f"viser cannot be loaded ({error}); try: pip install 'gsedit[web]'"
        ) from error
    return viser


def has_screen() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


PROBE_TIMEOUT = 120
"""Seconds for two points: a driver that hangs does not draw, and the first read from a slow disk
is slow."""
_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16])
plotter.add_points(pyvista.PolyData([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
plotter.screenshot(return_img=True)
"""


def check_drawing() -> None:
    """Draw two points in another process: without OpenGL, VTK ends the process it runs in.

    Raises GseditError where that fails.
    """
    import_pyvista()
    if not _runs(_PROBE):
        raise GseditError(
            "pyvista finds no OpenGL to draw with; on Debian: "
            "apt-get install -y libegl1 libgl1 libgl1-mesa-dri libx11-6"
        )


@cache
def _runs(code: str) -> bool:
    """Whether a process of its own ends well; asked once, as it takes a second or two."""
    command = [sys.executable, "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=PROBE_TIMEOUT)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0
