"""`gsedit preview`: a quick look at a scene as a point cloud."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import From, LookAt, Up, load_photos, point, recorded_viewpoints, up_vector
from .console import print_message, print_result
from .options import (
    Common,
    Data,
    DropInvalid,
    Force,
    Scene,
    check_file,
    load_file,
    load_scene,
    output,
    scene_file,
)

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.viewer.drawing import Look, Surroundings
    from rasterizer.scene import Gaussians


def pixels(flag: str, help: str) -> Any:
    return typer.Option(flag, min=16, metavar="PIXELS", help=help)


After = Annotated[
    Path | None,
    typer.Argument(
        metavar="[AFTER]",
        help="A second scene, shown beside the first.",
        show_default=False,
        callback=lambda path: None if path is None else scene_file(path),
    ),
]
Selection = Annotated[
    Path | None,
    typer.Option(
        "--selection",
        metavar="FLAGS.npy",
        show_default=False,
        help="One flag a Gaussian, such as the region.npy of an edit: what is selected is tinted.",
    ),
]


@dataclass(frozen=True)
class Drawn:
    """What a preview shows, and how."""

    color_by: Annotated[
        str | None,
        typer.Option(
            "--color-by",
            metavar="NAME",
            show_default="color, or selection with --selection",
            help="color, selection, depth, opacity, size, anisotropy, x, y, z, or a column of the "
            "file, such as f_dc_0.",
        ),
    ] = None
    colormap: Annotated[
        str, typer.Option("--colormap", metavar="NAME", help="A colour map of matplotlib.")
    ] = "viridis"
    selection: Selection = None
    ellipsoids: Annotated[
        bool,
        typer.Option(
            "--ellipsoids",
            help="Draw the selection, or the scene where there is none, as ellipsoids of two "
            "standard deviations; at most 20,000.",
        ),
    ] = False
    cameras: Annotated[
        bool,
        typer.Option(
            "--cameras", help="Draw the cameras: those of --data, or of cameras.json beside SCENE."
        ),
    ] = False
    sparse: Annotated[
        bool, typer.Option("--sparse", help="Draw the sparse cloud of --data, in orange.")
    ] = False
    min_opacity: Annotated[
        float,
        typer.Option("--min-opacity", min=0, max=1, help="Leave out Gaussians of lower opacity."),
    ] = 0.1

    def check(self, data: Path | None) -> None:
        """Raise UsageError for options that do not fit each other."""
        from gsedit.errors import UsageError

        if self.sparse and data is None:
            raise UsageError("--sparse draws the sparse cloud of a capture: add --data DATASET")

    @property
    def look(self) -> Look:
        from gsedit.viewer.drawing import Look

        by = self.color_by or ("color" if self.selection is None else "selection")
        return Look(by, self.colormap, ellipsoids=self.ellipsoids)

    def flags(self, scene: Gaussians) -> Tensor | None:
        """The selection, a flag a Gaussian."""
        from gsedit.regions.region import read_flags

        return None if self.selection is None else read_flags(self.selection, len(scene))

    def shown(self, around: Surroundings) -> Surroundings:
        """Of the cameras and the sparse cloud, what is asked for. Raises UsageError."""
        from gsedit.errors import UsageError
        from gsedit.viewer.drawing import Surroundings

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


def preview(
    scene: Scene,
    after: After = None,
    out: Annotated[Path | None, output("PNG to write; without it a window opens.")] = None,
    data: Data = None,
    up: Up = None,
    look_at: LookAt = None,
    eye: From = None,
    width: Annotated[int, pixels("--width", "Width of the picture of a scene.")] = 960,
    height: Annotated[int, pixels("--height", "Height of the picture.")] = 720,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    drawn: Drawn,
    common: Common,
) -> None:
    """Show the centres of the Gaussians as points: in a window, or as a PNG with -o.

    Seen from the first camera of --data or of the cameras.json beside the scene, or else from
    around it. With AFTER, two scenes are shown side by side from the same camera.

    gsedit preview scene.ply -o scene.png --color-by size

    gsedit preview before.ply after.ply -o both.png
    """
    from gsedit.errors import UsageError

    axis, target, stand = up_vector(up), point(look_at, "--look-at"), point(eye, "--from")
    drawn.check(data)
    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"-o {out}: name a .png file")
        check_file(out, force)
    common.apply()

    from gsedit.viewer.preview import preview as show
    from gsedit.views.framing import framing_camera
    from gsedit.views.viewpoints import framed

    file = load_file(scene, drop_invalid=drop_invalid)
    gaussians = file.scene
    second = None if after is None else load_scene(after, drop_invalid=drop_invalid)
    placed = stand is not None or target is not None
    around = surroundings(
        scene, gaussians, data, wanted=drawn.cameras or (axis is None and not placed)
    )
    size, camera = (width, height), None
    if placed:
        camera = framing_camera(gaussians, up=axis, eye=stand, target=target, size=size)
    elif axis is None and around.cameras and not drawn.cameras:
        camera = framed(around.cameras[0].camera, width, height)
    show(
        gaussians, out, after=second, selection=drawn.flags(gaussians), look=drawn.look, up=axis,
        around=drawn.shown(around), camera=camera, size=size, min_opacity=drawn.min_opacity,
        extra=file.extra, titles=(scene.name, "" if after is None else after.name), overwrite=force,
    )  # fmt: skip
    if out is not None:
        print_message(f"{out} shows {len(gaussians)} Gaussians as points")
        print_result({"picture": str(out)}, str(out), as_json=common.json)


def surroundings(path: Path, scene: Gaussians, data: Path | None, *, wanted: bool) -> Surroundings:
    """The cameras and the sparse cloud of --data, or the cameras recorded beside the scene."""
    from gsedit.viewer.drawing import Surroundings
    from gsedit.views.viewpoints import Viewpoint

    if data is not None:
        photos = load_photos(data, 256, path)
        views = tuple(Viewpoint(view.name, view.camera) for view in photos.views)
        return Surroundings(views, photos.points)
    return Surroundings(recorded_viewpoints(path, scene, 256) if wanted else ())
