"""`gsedit view`: one or two scenes in the browser, as a page, or as points."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import InputError, UsageError

from ..core.command import argument, option, shows
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.cameras import Placing, ViewOptions, known_cameras
from ..options.common import Reads, Scene, Writes, load_file, scene_file

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.formats.scenes import SceneFile
    from gsedit.pictures.viewer.browser import Page
    from gsedit.pictures.viewer.drawing import Look, Surroundings
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

PAGE_SIZE = (960, 720)
"""(width, height) in pixels of the picture whose field of view the page begins with."""

After = Annotated[
    Path | None,
    argument(
        "AFTER",
        "A second scene, shown beside the first.",
        callback=lambda path: None if path is None else scene_file(path),
    ),
]


@dataclass(frozen=True)
class ShowOptions(Reads, Writes):
    """Options of `gsedit view` alone."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """File to write: an .html page that opens from disk, or a .png of points."""
    selection: Path | None = option(None, "FLAGS.npy")
    """One flag a Gaussian, such as the region.npy of an edit: what is selected is tinted."""
    port: int = option(8080, min=1, max=65535)
    """Port of the live page; the next free one if it is taken."""


@dataclass(frozen=True)
class PointOptions:
    """How a picture of points is drawn."""

    window: bool = option(False)
    """Open a window of points instead of a page."""
    width: int = option(960, "PIXELS", min=16)
    """Width of the picture of a scene."""
    height: int = option(720, "PIXELS", min=16)
    """Height of the picture."""
    color_by: str | None = option(None, "NAME")
    """color, selection, depth, a value of --where (opacity, size, longest, anisotropy, luminance,
    x, ...), or a column of the file (f_dc_0, ...). None: color, or selection with --selection."""
    colormap: str = option("viridis", "NAME")
    """Color map of matplotlib."""
    ellipsoids: bool = option(False)
    """Draw the selection, or the scene where there is none, as ellipsoids of two standard
    deviations; at most 20,000."""
    cameras: bool = option(False)
    """Draw the cameras: those of --data, or of cameras.json beside SCENE."""
    sparse: bool = option(False)
    """Draw the sparse cloud of --data, in orange."""
    open3d: bool = option(False)
    """Let Open3D draw: splats through software Vulkan, or points where there is none; points in a
    window."""
    min_opacity: float = option(0.1, min=0, max=1)
    """Hide Gaussians of lower opacity."""

    def check_unused(self) -> None:
        """Raise UsageError for an option of points where a page is shown."""
        usual = PointOptions()
        given = [name for name, value in vars(self).items() if value != getattr(usual, name)]
        if given:
            flag = f"--{given[0].replace('_', '-')}"
            raise UsageError(f"{flag} is for points: add --window, or name a .png file with -o")

    def check(self, data: Path | None, after: Path | None, selection: Path | None) -> None:
        """Raise UsageError for options that do not fit each other."""
        others = {
            "AFTER": after, "--color-by": self.color_by, "--selection": selection,
            "--ellipsoids": self.ellipsoids, "--cameras": self.cameras, "--sparse": self.sparse,
        }  # fmt: skip
        if self.open3d and (given := [name for name, value in others.items() if value]):
            raise UsageError(f"--open3d draws one scene in its colors: leave out {given[0]}")
        if selection and self.color_by not in (None, "selection") and not self.ellipsoids:
            raise UsageError(
                f"--color-by {self.color_by} does not show --selection: add --ellipsoids, or leave "
                "one of them out"
            )
        if self.sparse and data is None:
            raise UsageError("--sparse draws the sparse cloud of a capture: add --data DATASET")

    def look(self, selection: Path | None) -> Look:
        """Return the style of the points."""
        from gsedit.pictures.viewer.drawing import Look

        by = self.color_by or ("color" if selection is None else "selection")
        return Look(by, self.colormap, ellipsoids=self.ellipsoids)

    def counted(self, scene: Gaussians) -> str:
        """Return how many Gaussians the picture shows, as text."""
        if self.open3d:
            return f"{len(scene):,} Gaussians"
        solid = int((scene.opacities >= self.min_opacity).sum())
        if solid == len(scene):
            return f"{solid:,} Gaussians as points"
        kept = f"those of opacity {self.min_opacity:g} or more"
        return f"{solid:,} of {len(scene):,} Gaussians as points, {kept}"

    def visible(self, around: Surroundings) -> Surroundings:
        """Return the cameras and the sparse cloud to draw. Raises UsageError without any."""
        from gsedit.pictures.viewer.drawing import Surroundings

        if self.cameras and not around.cameras:
            raise UsageError(
                "--cameras: no cameras are known: add --data DATASET, or put the capture's "
                "cameras.json beside the scene"
            )
        if self.sparse and around.points is None:
            raise UsageError("--sparse: the dataset holds no sparse cloud: leave --sparse out")
        return Surroundings(
            around.cameras if self.cameras else (), around.points if self.sparse else None
        )


@dataclass(frozen=True)
class ViewerCamera(Placing):
    """Camera that looks at the scene."""

    def surroundings(self, path: Path, scene: Gaussians, *, wanted: bool) -> Surroundings:
        """The cameras and the sparse cloud of --data; else, if they are `wanted` or the view may
        begin there, the cameras recorded beside the scene."""
        from gsedit.pictures.viewer.drawing import Surroundings

        if self.placed and not wanted and self.data is None:
            return Surroundings()
        known = known_cameras(path, scene, ViewOptions(self.data))
        if known is None:
            return Surroundings()
        points = None if known.photos is None else known.photos.points
        return Surroundings(known.viewpoints, points)

    def camera(
        self, scene: Gaussians, viewpoints: tuple[Viewpoint, ...], size: tuple[int, int]
    ) -> Camera | None:
        """Return the camera of --from, --look-at and --up, else the first viewpoint, else None.

        `size` is (width, height)."""
        from gsedit.scene.framing import framing_camera
        from gsedit.views.viewpoints import framed

        if not self.placed:
            return framed(viewpoints[0].camera, *size) if viewpoints else None
        wish = self.wish()
        return framing_camera(scene, up=wish.up, eye=wish.eye, target=wish.look_at, size=size)


@shows(
    "--output", "--window", "--selection", "--data", "--cameras", "--color-by", "--ellipsoids",
    "--look-at", "--from", "--up", "--force",
)  # fmt: skip
def view(
    scene: Scene,
    after: After = None,
    *,
    own: ShowOptions,
    viewer: ViewerCamera,
    points: PointOptions,
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
    as_points = points.window or (own.out is not None and own.out.suffix.lower() == ".png")
    if as_points:
        points.check(viewer.data, after, own.selection)
    else:
        points.check_unused()
    check_file(own.out, own.force, ".png" if as_points else ".html")
    if as_points:
        show_points(scene, after, own, viewer, points)
    else:
        show_page(scene, after, own, viewer)


def show_page(scene: Path, other: Path | None, own: ShowOptions, viewer: ViewerCamera) -> None:
    """Write the page of splats, or serve it."""
    from gsedit.pictures.viewer.browser import make_page, write_page
    from gsedit.pictures.viewer.libraries import import_viser
    from gsedit.scene.framing import framing_camera

    import_viser()  # before the long part
    first, second = read(scene, other, own)
    before, after = first.scene, second and second.scene
    around = viewer.surroundings(scene, before, wanted=True)
    camera = viewer.camera(before, around.cameras, PAGE_SIZE)
    flags = own.selection or edited_region(scene, other)
    page = make_page(
        before, camera or framing_camera(before, size=PAGE_SIZE), after=after,
        cameras=around.cameras, region=read_selection(flags, after, before),
        title=" | ".join(each.name for each in (scene, other) if each),
    )  # fmt: skip
    say_what_differs(before, after)
    if own.out is None:
        serve(page, own.port)
        return
    write_page(page, own.out, overwrite=own.force)
    print_message(f"{own.out} shows {len(before)} Gaussians, from disk and without a network")
    print_result({"page": str(own.out)}, str(own.out))


def read(scene: Path, other: Path | None, own: ShowOptions) -> tuple[SceneFile, SceneFile | None]:
    """Read both scenes; the second is None where there is one."""
    first = load_file(scene, drop_invalid=own.drop_invalid)
    return first, None if other is None else load_file(other, drop_invalid=own.drop_invalid)


def show_points(
    path: Path, other: Path | None, own: ShowOptions, viewer: ViewerCamera, points: PointOptions
) -> None:
    """Write the picture of points, or open a window of them."""
    from gsedit.pictures.viewer.drawing import preview

    first, second = read(path, other, own)
    out, names = own.out, (path.name, "" if other is None else other.name)
    scene, size = first.scene, (points.width, points.height)
    around = viewer.surroundings(path, scene, wanted=points.cameras)
    camera = viewer.camera(scene, () if points.cameras else around.cameras, size)
    if points.open3d and out is not None:
        draw_with_open3d(scene, out, camera, size, own.force)
    else:
        preview(
            scene, out, after=second and second.scene,
            selection=read_selection(own.selection, scene), look=points.look(own.selection),
            around=points.visible(around), extra=first.extra,
            after_extra=second and second.extra, min_opacity=points.min_opacity, size=size,
            camera=camera, titles=names, overwrite=own.force,
        )  # fmt: skip
    if out is not None:
        print_message(f"{out} shows {points.counted(scene)}")
        print_result({"picture": str(out)}, str(out))


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
    import torch

    from gsedit.formats.flags import read_flags

    if path is None:
        return None
    *others, last = [len(scene) for scene in scenes if scene is not None]
    for count in others:
        with suppress(InputError):
            return torch.from_numpy(read_flags(path, count))
    return torch.from_numpy(read_flags(path, last))


def say_what_differs(before: Gaussians, after: Gaussians | None) -> None:
    """A line for what a browser does not show as the renderer does, and for too large a scene."""
    if before.degree:
        print_message("colors are those of SH degree 0: a browser page has no view dependence")
    count = len(before) + (0 if after is None else len(after))
    if count > 2_000_000:  # what a browser on a laptop turns smoothly
        print_message(f"{count:,} Gaussians may be slow in a browser: gsedit decimate makes fewer")


def serve(page: Page, port: int) -> None:
    """Keep a live page up until Ctrl-C."""
    import webbrowser
    from threading import Event

    from gsedit.pictures.viewer.browser import add_controls, server
    from gsedit.pictures.viewer.libraries import has_screen

    with server(page, port) as (live, handles):
        add_controls(live, page, handles)
        address = f"http://{live.get_host()}:{live.get_port()}"
        print_result({"address": address}, address)
        print_message("this machine alone reaches the page; Ctrl-C ends it")
        if has_screen():
            webbrowser.open(address)
        try:
            Event().wait()
        except KeyboardInterrupt:
            print_message("the page has ended")
