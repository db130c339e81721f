"""`gsedit app`: a page in the browser to open, edit, compare and export scenes."""

from __future__ import annotations

import os
import signal
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Timer
from typing import Annotated

from gsedit.errors import UsageError

from ..core.command import argument, option, shows
from ..core.console import print_message, print_result

Opened = Annotated[
    Path | None,
    argument("PATH", "A scene, the folder of an edit or of a session, photos, or a video."),
]


@dataclass(frozen=True)
class AppOptions:
    """Options of `gsedit app` alone."""

    port: int = option(8080, min=1, max=65535)
    """Port of the page; the next free one if it is taken."""
    no_browser: bool = option(False)
    """Only print the address."""
    allow: list[Path] | None = option(None, "FOLDER")
    """Folder that the page may read and write too; repeatable."""
    host: str = option("127.0.0.1", "ADDRESS")
    """Address to listen at; another than this machine's own can be reached by whoever has the
    page's address."""


@shows("--port", "--no-browser", "--allow", "--host")
def app(path: Opened = None, *, own: AppOptions) -> None:
    """Edit scenes in the browser: open, point, say, compare, keep.

    gsedit app scene.ply

    gsedit app photos/

    Everything is kept in a folder beside what is opened, NAME.session: the same command goes on
    where it was. The page reads and writes below the folder of PATH, or the current one. Ctrl-C
    ends it.
    """
    from gsedit.pictures.viewer.libraries import import_viser

    import_viser()  # before the long part
    if path is not None and not path.exists():
        raise UsageError(f"{path} does not exist: check the path")
    run_page(path, own)


def run_page(path: Path | None, own: AppOptions) -> None:
    """Serve the page until Ctrl-C."""
    from gsedit.app.loaded import share_heaps
    from gsedit.app.opening import open_path
    from gsedit.app.page import Page
    from gsedit.app.places import Places
    from gsedit.app.server import serve
    from gsedit.app.worker import Worker

    share_heaps()
    given = Path.cwd() if path is None else path.resolve().parent
    places = Places(tuple(each.resolve() for each in (given, *(own.allow or ()))))
    page = Page(Worker((sys.executable, "-m", "gsedit_cli.core.warm")), places)
    try:
        if path is not None:
            open_path(page, path.resolve())
        with serve(page, own.host, own.port) as served:
            if served.port != own.port:
                print_message(f"port {own.port} is taken: the page is at port {served.port}")
            print_message(f"the page is open until Ctrl-C: {served.address}")
            print_result({"address": served.address}, served.address)
            if not own.no_browser:
                webbrowser.open(served.address)
            start_later(page.worker.warm)
            wait()
    finally:
        page.close()
    end()


def end() -> None:
    """End the process: threads that still draw or prepare are not waited for, and the interpreter
    would end them inside C++, which aborts it."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def start_later(work: Callable[[], None]) -> None:
    """Call a function once the first picture has had the processor to itself."""
    timer = Timer(2.0, work)  # after the first picture
    timer.daemon = True
    timer.start()


def wait() -> None:
    """Return at Ctrl-C, and at SIGTERM; end the process at a second one."""
    ended = Event()
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda *_: end() if ended.is_set() else ended.set())
    while not ended.wait(3600):
        pass
