"""Options of `gsedit view`: the scenes, and the camera that looks at them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError

from ..core.command import argument, flag, option
from .cameras import Placing, load_photos, recorded_viewpoints
from .common import scene_file

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.pictures.viewer.drawing import Look, Surroundings
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians


@dataclass(frozen=True)
class PointOptions:
    """How a picture of points is drawn."""

    window: bool = option(False, "Open a window of points instead of a page.")
    width: int = option(960, "Width of the picture of a scene.", "PIXELS", min=16)
    height: int = option(720, "Height of the picture.", "PIXELS", min=16)
    color_by: str | None = option(
        None,
        "color, selection, depth, a value of --where (opacity, size, longest, anisotropy, "
        "luminance, x, ...), or a column of the file (f_dc_0, ...).",
        "NAME",
        show_default="color, or selection with --selection",
    )
    colormap: str = option("viridis", "Color map of matplotlib.", "NAME")
    ellipsoids: bool = option(
        False,
        "Draw the selection, or the scene where there is none, as ellipsoids of two standard "
        "deviations; at most 20,000.",
    )
    cameras: bool = option(
        False, "Draw the cameras: those of --data, or of cameras.json beside SCENE."
    )
    sparse: bool = option(False, "Draw the sparse cloud of --data, in orange.")
    open3d: bool = option(
        False,
        "Let Open3D draw: splats through software Vulkan.",
    )
    min_opacity: float = option(0.1, "Hide Gaussians of lower opacity.", min=0, max=1)

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
            "--window": self.window,
        }  # fmt: skip
        if self.open3d and (given := [name for name, value in others.items() if value]):
            raise UsageError(
                f"--open3d draws a picture of one scene in its colors: leave out {given[0]}"
            )
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


After = Annotated[
    Path | None,
    argument(
        "AFTER",
        "A second scene, shown beside the first.",
        callback=lambda path: None if path is None else scene_file(path),
    ),
]
SelectionFile = Annotated[
    Path | None,
    flag(
        "--selection",
        "One flag a Gaussian, such as the region.npy of an edit: what is selected is tinted.",
        "FLAGS.npy",
    ),
]


@dataclass(frozen=True)
class ViewerCamera(Placing):
    """Camera that looks at the scene."""

    def surroundings(self, path: Path, scene: Gaussians, *, wanted: bool) -> Surroundings:
        """The cameras and the sparse cloud of --data; else, if they are `wanted` or the view may
        begin there, the cameras recorded beside the scene."""
        from gsedit.datasets.viewpoints import viewpoints_of
        from gsedit.pictures.viewer.drawing import Surroundings

        if self.data is not None:
            photos = load_photos(self.data, 256, path)
            return Surroundings(viewpoints_of(photos), photos.points)
        if wanted or not self.placed:
            return Surroundings(recorded_viewpoints(path, scene, 256))
        return Surroundings()

    def camera(
        self, scene: Gaussians, viewpoints: tuple[Viewpoint, ...], size: tuple[int, int]
    ) -> Camera | None:
        """Return the camera of --from, --look-at and --up, else the first viewpoint, else None.

        `size` is (width, height)."""
        from gsedit.datasets.viewpoints import framed
        from gsedit.scene.framing import framing_camera

        if not self.placed:
            return framed(viewpoints[0].camera, *size) if viewpoints else None
        wish = self.wish()
        return framing_camera(scene, up=wish.up, eye=wish.eye, target=wish.look_at, size=size)
