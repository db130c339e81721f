"""`gsedit view`: a scene in the browser, live or as one file."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import print_message, print_result
from .looking import After, Selection, Standpoint, check_suffix
from .options import Common, DropInvalid, Force, Scene, load_scene, output

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.viewer.browser import Page
    from rasterizer.scene import Gaussians

SIZE = (960, 720)
"""Of the picture whose field of view the page begins with, pixels."""
MANY = 2_000_000
"""Gaussians that a browser on a laptop still turns smoothly; a guess of what users report."""

Port = Annotated[
    int,
    typer.Option(
        "--port", min=1, max=65535, help="Port of the live page; the next free one if it is taken."
    ),
]


def view(
    scene: Scene,
    after: After = None,
    out: Annotated[
        Path | None, output("HTML file to write, which opens from disk; without it, a live page.")
    ] = None,
    selection: Selection = None,
    port: Port = 8080,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    standpoint: Standpoint,
    common: Common,
) -> None:
    """Show the splats of a scene in the browser, with buttons for before / after, a selection and
    the cameras of the capture.

    A live page is reached from this machine only; Ctrl-C ends it. Colours are those of SH degree 0.
    The region.npy of an edit's folder is the selection where none is given.

    gsedit view before.ply out/bronze -o page.html
    """
    standpoint.check()
    check_suffix(out, ".html", force=force)
    common.apply()

    from gsedit.viewer.browser import make_page, write_page
    from gsedit.viewer.libraries import import_viser
    from gsedit.views.framing import framing_camera

    import_viser()  # before the long part
    before = load_scene(scene, drop_invalid=drop_invalid)
    second = None if after is None else load_scene(after, drop_invalid=drop_invalid)
    around = standpoint.surroundings(scene, before, wanted=True)
    camera = standpoint.camera(before, around.cameras, SIZE) or framing_camera(before, size=SIZE)
    page = make_page(
        before, camera, after=second, cameras=around.cameras,
        region=read_selection(selection or edited_region(scene, after), second, before),
        title=scene.name if after is None else f"{scene.name} | {after.name}",
    )  # fmt: skip
    say_what_differs(before, second)
    if out is None:
        serve(page, port, common)
        return
    write_page(page, out, overwrite=force)
    print_message(f"{out} shows {len(before)} Gaussians, from disk and without a network")
    print_result({"page": str(out)}, str(out), as_json=common.json)


def edited_region(scene: Path, after: Path | None) -> Path | None:
    """The region.npy in the folder of an edit that one of the scenes is; the second one first."""
    for path in (after, scene):
        if path is not None and path.name == "scene.ply":
            flags = path.with_name("region.npy")
            if flags.is_file():
                print_message(f"the selection is the region of the edit, {flags}")
                return flags
    return None


def read_selection(path: Path | None, *scenes: Gaussians | None) -> Tensor | None:
    """The flags of a file, for the first of the scenes that has as many Gaussians."""
    from gsedit.errors import InputError
    from gsedit.regions.region import read_flags

    if path is None:
        return None
    *others, last = [len(scene) for scene in scenes if scene is not None]
    for count in others:
        with suppress(InputError):
            return read_flags(path, count)
    return read_flags(path, last)


def say_what_differs(before: Gaussians, after: Gaussians | None) -> None:
    """A line for what a browser does not show as the renderer does, and for too large a scene."""
    if before.degree:
        print_message("colours are those of SH degree 0: a browser page has no view dependence")
    count = len(before) + (0 if after is None else len(after))
    if count > MANY:
        print_message(f"{count:,} Gaussians may be slow in a browser: gsedit decimate makes fewer")


def serve(page: Page, port: int, common: Common) -> None:
    """Keep a live page up until Ctrl-C."""
    import webbrowser
    from threading import Event

    from gsedit.viewer.browser import add_controls, server
    from gsedit.viewer.libraries import has_screen

    with server(page, port) as (live, handles):
        add_controls(live, page, handles)
        address = f"http://{live.get_host()}:{live.get_port()}"
        print_result({"address": address}, address, as_json=common.json)
        print_message("this machine alone reaches the page; Ctrl-C ends it")
        if has_screen():
            webbrowser.open(address)
        try:
            Event().wait()
        except KeyboardInterrupt:
            print_message("the page has ended")
