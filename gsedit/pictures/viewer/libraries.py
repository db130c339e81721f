"""The libraries of the viewers: loaded when they are used, refused with what to install."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

from gsedit.errors import GseditError, UsageError
from gsedit.run.environment import load_extra, load_package


def import_open3d() -> Any:
    """The module open3d. Raises GseditError where it cannot be loaded."""
    return load_extra("open3d", "this")


def import_pyvista() -> Any:
    """The module pyvista. Raises GseditError where it cannot be loaded."""
    if not has_screen():  # must be set before VTK is loaded: without it VTK wants an X server
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    return load_extra("pyvista", "a picture of points")


def import_viser() -> Any:
    """The module viser. Raises GseditError where it cannot be loaded."""
    return load_package("viser", "viser cannot be loaded", "pip install viser")


def has_screen() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def check_screen() -> None:
    """Raise UsageError where no window can be opened."""
    if not has_screen():
        raise UsageError("there is no screen to open a window on: give -o picture.png")


PROBE_TIMEOUT = 120
"""Seconds for two points: a driver that hangs does not draw, and the first read from a slow disk
is slow."""
_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[16, 16])
plotter.add_points(pyvista.PolyData([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
plotter.screenshot(return_img=True)
"""


def check_drawing(probe: str = _PROBE) -> None:
    """Run `probe`, which draws, in another process: without OpenGL, VTK ends its process.

    Raises GseditError where that fails.
    """
    import_pyvista()
    if not _runs(probe):
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


LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine for itself. Any web site can let a name of its own point here too."""
_starting = Lock()


def refusal(headers: Any, hosts: Collection[str] = LOOPBACK) -> str:
    """Say why a request is refused, by its HTTP headers; empty where it is answered.

    The host that it was sent to must be one of `hosts`, by default this machine's loopback, under
    any port, for a tunnel has its own. The origin must be that host: a browser names it in every
    WebSocket handshake.
    """
    named, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(named) != 1 or _host_name(named[0]) not in hosts:
        return f"the page is reached as http://{min(hosts)} only"
    socket = any("websocket" in value.lower() for value in headers.get_all("Upgrade"))
    if (origins or socket) and origins != [f"http://{named[0]}"]:
        return "the page answers only itself"
    return ""


def own_origin(connection: Any, request: Any) -> Any:
    """Refuse what `refusal` names; None for any other request."""
    reason = refusal(request.headers)
    return connection.respond(403, f"{reason}\n") if reason else None


@contextmanager
def guarded(answer: Callable[[Any, Any], Any] = own_origin) -> Iterator[None]:
    """Guard the servers that viser starts meanwhile: it has no setting for this.

    `answer(connection, request)` returns the response to a request, or None where viser's own
    server goes on with it. By default a page answers only this machine, and no other web site.
    """
    from websockets.asyncio import server

    def serve_guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def first(connection: Any, request: Any) -> Any:
            return answer(connection, request) or process_request(connection, request)

        return serve(*arguments, process_request=first, **options)

    with _starting:
        serve = server.serve
        server.serve = serve_guarded  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            server.serve = serve  # pyright: ignore[reportAttributeAccessIssue]


def _host_name(host: str) -> str:
    """Take the port off a Host header; empty where it is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
