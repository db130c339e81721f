"""`gsedit preview`: a quick look at a scene as a point cloud."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message, print_result
from .looking import After, Selection, Standpoint, check_suffix
from .options import Common, DropInvalid, Force, Scene, load_file, output

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.viewer.drawing import Look, Surroundings
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians


def pixels(flag: str, help: str) -> Any:
    return typer.Option(flag, min=16, metavar="PIXELS", help=help)


@dataclass(frozen=True)
class Drawn:
    """What a preview shows, and how."""

    color_by: Annotated[
        str | None,
        typer.Option(
            "--color-by",
            metavar="NAME",
            show_default="color, or selection with --selection",
            help="color, selection, depth, a value of gsedit filter --where (opacity, size, "
            "longest, anisotropy, luminance, x, ...), or a column of the file (f_dc_0, ...).",
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
    open3d: Annotated[
        bool,
        typer.Option(
            "--open3d",
            help="Let Open3D draw: splats through software Vulkan, or points where there is none; "
            "points in a window.",
        ),
    ] = False
    min_opacity: Annotated[
        float,
        typer.Option("--min-opacity", min=0, max=1, help="Leave out Gaussians of lower opacity."),
    ] = 0.1

    def check(self, data: Path | None, after: Path | None) -> None:
        """Raise UsageError for options that do not fit each other."""
        from gsedit.errors import UsageError

        others = {
            "AFTER": after, "--color-by": self.color_by, "--selection": self.selection,
            "--ellipsoids": self.ellipsoids, "--cameras": self.cameras, "--sparse": self.sparse,
        }  # fmt: skip
        if self.open3d and (given := [name for name, value in others.items() if value]):
            raise UsageError(f"--open3d draws one scene in its colours: leave out {given[0]}")
        if self.selection and self.color_by not in (None, "selection") and not self.ellipsoids:
            raise UsageError(
                f"--color-by {self.color_by} does not show --selection: add --ellipsoids, or leave "
                "one of them out"
            )
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

    def counted(self, scene: Gaussians) -> str:
        """How many Gaussians the picture shows, for a person."""
        if self.open3d:
            return f"{len(scene):,} Gaussians"
        solid = int((scene.opacities >= self.min_opacity).sum())
        if solid == len(scene):
            return f"{solid:,} Gaussians as points"
        kept = f"those of opacity {self.min_opacity:g} or more"
        return f"{solid:,} of {len(scene):,} Gaussians as points, {kept}"

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
    width: Annotated[int, pixels("--width", "Width of the picture of a scene.")] = 960,
    height: Annotated[int, pixels("--height", "Height of the picture.")] = 720,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    standpoint: Standpoint,
    drawn: Drawn,
    common: Common,
) -> None:
    """Show the centres of the Gaussians as points: in a window, or as a PNG with -o.

    Seen from the first camera of --data or of the cameras.json beside the scene, or else from
    around it. With AFTER, two scenes are shown side by side from the same camera.

    gsedit preview scene.ply -o scene.png --color-by size

    gsedit preview before.ply after.ply -o both.png
    """
    standpoint.check()
    drawn.check(standpoint.data, after)
    check_suffix(out, ".png", force=force)
    common.apply()

    from gsedit.viewer.preview import preview as show

    file = load_file(scene, drop_invalid=drop_invalid)
    gaussians, size = file.scene, (width, height)
    second = None if after is None else load_file(after, drop_invalid=drop_invalid)
    around = standpoint.surroundings(scene, gaussians, wanted=drawn.cameras)
    camera = standpoint.camera(gaussians, () if drawn.cameras else around.cameras, size)
    if drawn.open3d:
        draw_with_open3d(gaussians, out, camera, size, drawn.min_opacity, force)
    else:
        show(
            gaussians, out, after=second and second.scene, selection=drawn.flags(gaussians),
            look=drawn.look, around=drawn.shown(around), extra=file.extra,
            after_extra=second and second.extra, min_opacity=drawn.min_opacity, size=size,
            camera=camera, titles=(scene.name, "" if after is None else after.name),
            overwrite=force,
        )  # fmt: skip
    if out is not None:
        print_message(f"{out} shows {drawn.counted(gaussians)}")
        print_result({"picture": str(out)}, str(out), as_json=common.json)


def draw_with_open3d(
    scene: Gaussians,
    out: Path | None,
    camera: Camera | None,
    size: tuple[int, int],
    min_opacity: float,
    force: bool,
) -> None:
    """Open3D's picture or window; what to know of it is printed."""
    from gsedit.viewer.open3d_drawing import preview_open3d

    note = preview_open3d(
        scene, out, camera=camera, size=size, min_opacity=min_opacity, overwrite=force
    )
    if note:
        print_message(note)
