"""`gsedit view`: one or two scenes in the browser, as a page, or as points."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import InputError

from ..core.command import flag, shows
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.common import Common, DropInvalid, Force, Scene, load_file
from ..options.viewer import After, PointOptions, SelectionFile, ViewerCamera

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.formats.scenes import SceneFile
    from gsedit.pictures.viewer.browser import Page
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

PAGE_SIZE = (960, 720)
"""(width, height) in pixels of the picture whose field of view the page begins with."""
SMOOTH_GAUSSIANS = 2_000_000
"""Gaussians that a browser on a laptop still turns smoothly; a guess of what users report."""

Port = Annotated[
    int, flag("", "Port of the live page; the next free one if it is taken.", min=1, max=65535)
]


@shows(
    "--output", "--window", "--selection", "--data", "--cameras", "--color-by", "--ellipsoids",
    "--look-at", "--from", "--up", "--force",
)  # fmt: skip
def view(
    scene: Scene,
    after: After = None,
    out: Annotated[
        Path | None,
        flag(
            "--output -o",
            "File to write: an .html page that opens from disk, or a .png of points.",
            "PATH",
        ),
    ] = None,
    selection: SelectionFile = None,
    port: Port = 8080,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    viewer: ViewerCamera,
    points: PointOptions,
    common: Common,
) -> None:
    """Show one or two scenes in the browser, as a page, or as points.

    gsedit view scene.ply

    gsedit view before.ply out/bronze -o page.html

    gsedit view scene.ply -o points.png --color-by size

    Without -o, a live page opens in the browser, or with --window a window of points. A live page
    is reached from this machine only; Ctrl-C ends it. The page shows colors of SH degree 0, the
    cameras of the capture, and the region of an edit as the selection.
    """
    viewer.wish()  # it raises
    as_points = points.window or (out is not None and out.suffix.lower() == ".png")
    if as_points:
        points.check(viewer.data, after, selection)
        check_file(out, force, ".png")
    else:
        points.check_unused()
        check_file(out, force, ".html")
    common.apply()
    scenes = Scenes(scene, after, selection, drop_invalid)
    if as_points:
        show_points(scenes, out, viewer, points, force, as_json=common.json)
    else:
        show_page(scenes, out, viewer, port, force, as_json=common.json)


@dataclass(frozen=True)
class Scenes:
    """Files that a view shows."""

    scene: Path
    after: Path | None
    selection: Path | None
    drop_invalid: bool

    @property
    def names(self) -> tuple[str, str]:
        """Return the names of both scenes; the second is empty where there is one scene."""
        return self.scene.name, "" if self.after is None else self.after.name

    def read(self) -> tuple[SceneFile, SceneFile | None]:
        """Read both scenes; the second is None where there is one."""
        first = load_file(self.scene, drop_invalid=self.drop_invalid)
        if self.after is None:
            return first, None
        return first, load_file(self.after, drop_invalid=self.drop_invalid)


def show_page(
    scenes: Scenes,
    out: Path | None,
    viewer: ViewerCamera,
    port: int,
    force: bool,
    *,
    as_json: bool,
) -> None:
    """Write the page of splats, or serve it."""
    from gsedit.pictures.viewer.browser import make_page, write_page
    from gsedit.pictures.viewer.libraries import import_viser
    from gsedit.scene.framing import framing_camera

    import_viser()  # before the long part
    first, second = scenes.read()
    before, after = first.scene, second and second.scene
    around = viewer.surroundings(scenes.scene, before, wanted=True)
    camera = viewer.camera(before, around.cameras, PAGE_SIZE)
    flags = scenes.selection or edited_region(scenes.scene, scenes.after)
    page = make_page(
        before, camera or framing_camera(before, size=PAGE_SIZE), after=after,
        cameras=around.cameras, region=read_selection(flags, after, before),
        title=" | ".join(filter(None, scenes.names)),
    )  # fmt: skip
    say_what_differs(before, after)
    if out is None:
        serve(page, port, as_json=as_json)
        return
    write_page(page, out, overwrite=force)
    print_message(f"{out} shows {len(before)} Gaussians, from disk and without a network")
    print_result({"page": str(out)}, str(out), as_json=as_json)


def show_points(
    scenes: Scenes,
    out: Path | None,
    viewer: ViewerCamera,
    points: PointOptions,
    force: bool,
    *,
    as_json: bool,
) -> None:
    """Write the picture of points, or open a window of them."""
    from gsedit.pictures.viewer.drawing import preview

    first, second = scenes.read()
    scene, size = first.scene, (points.width, points.height)
    around = viewer.surroundings(scenes.scene, scene, wanted=points.cameras)
    camera = viewer.camera(scene, () if points.cameras else around.cameras, size)
    if points.open3d and out is not None:
        draw_with_open3d(scene, out, camera, size, force)
    else:
        preview(
            scene, out, after=second and second.scene,
            selection=read_selection(scenes.selection, scene), look=points.look(scenes.selection),
            around=points.visible(around), extra=first.extra,
            after_extra=second and second.extra, min_opacity=points.min_opacity, size=size,
            camera=camera, titles=scenes.names, overwrite=force,
        )  # fmt: skip
    if out is not None:
        print_message(f"{out} shows {points.counted(scene)}")
        print_result({"picture": str(out)}, str(out), as_json=as_json)


def draw_with_open3d(
    scene: Gaussians, out: Path, camera: Camera | None, size: tuple[int, int], force: bool
) -> None:
    """Open3D's picture; what to know of it is printed."""
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.viewer.open3d_drawing import draw_splats
    from gsedit.scene.framing import framing_camera

    picture, note = draw_splats(scene, camera or framing_camera(scene, size=size))
    save_picture(picture, out, overwrite=force)
    if note:
        print_message(note)


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
    from gsedit.select.region import read_flags

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
        print_message("colors are those of SH degree 0: a browser page has no view dependence")
    count = len(before) + (0 if after is None else len(after))
    if count > SMOOTH_GAUSSIANS:
        print_message(f"{count:,} Gaussians may be slow in a browser: gsedit decimate makes fewer")


def serve(page: Page, port: int, *, as_json: bool) -> None:
    """Keep a live page up until Ctrl-C."""
    import webbrowser
    from threading import Event

    from gsedit.pictures.viewer.browser import add_controls, server
    from gsedit.pictures.viewer.libraries import has_screen

    with server(page, port) as (live, handles):
        add_controls(live, page, handles)
        address = f"http://{live.get_host()}:{live.get_port()}"
        print_result({"address": address}, address, as_json=as_json)
        print_message("this machine alone reaches the page; Ctrl-C ends it")
        if has_screen():
            webbrowser.open(address)
        try:
            Event().wait()
        except KeyboardInterrupt:
            print_message("the page has ended")
