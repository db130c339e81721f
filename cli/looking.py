"""What `gsedit preview` and `gsedit view` share: which scenes they show, and from where."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import From, LookAt, Up, load_photos, point, recorded_viewpoints, up_vector
from .options import Data, check_file, scene_file

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.viewer.drawing import Surroundings
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

After = Annotated[
    Path | None,
    typer.Argument(
        metavar="AFTER",
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
class Standpoint:
    """Where the scene is looked at from."""

    data: Data = None
    up: Up = None
    look_at: LookAt = None
    eye: From = None

    def check(self) -> None:
        """Raise UsageError for a name that is no axis, or a text that is no point."""
        _ = self.axis, point(self.look_at, "--look-at"), point(self.eye, "--from")

    @property
    def axis(self) -> Tensor | None:
        return up_vector(self.up)

    @property
    def is_free(self) -> bool:
        """Whether no option says where the camera stands."""
        return self.up is None and self.look_at is None and self.eye is None

    def surroundings(self, path: Path, scene: Gaussians, *, wanted: bool) -> Surroundings:
        """The cameras and the sparse cloud of --data; else, if they are `wanted` or the view may
        begin there, the cameras recorded beside the scene."""
        from gsedit.viewer.drawing import Surroundings
        from gsedit.views.viewpoints import viewpoints_of

        if self.data is not None:
            photos = load_photos(self.data, 256, path)
            return Surroundings(viewpoints_of(photos), photos.points)
        if wanted or self.is_free:
            return Surroundings(recorded_viewpoints(path, scene, 256))
        return Surroundings()

    def camera(
        self, scene: Gaussians, viewpoints: tuple[Viewpoint, ...], size: tuple[int, int]
    ) -> Camera | None:
        """Where --from, --look-at and --up say, or else the first viewpoint; None for free choice.

        `size` is (width, height)."""
        from gsedit.views.framing import framing_camera
        from gsedit.views.viewpoints import framed

        if self.is_free:
            return framed(viewpoints[0].camera, *size) if viewpoints else None
        eye, target = point(self.eye, "--from"), point(self.look_at, "--look-at")
        return framing_camera(scene, up=self.axis, eye=eye, target=target, size=size)


def check_suffix(out: Path | None, suffix: str, *, force: bool) -> None:
    """Raise UsageError unless a file of that suffix can be written at `out`, if it is given."""
    from gsedit.errors import UsageError

    if out is None:
        return
    if out.suffix.lower() != suffix:
        raise UsageError(f"-o {out}: name a {suffix} file")
    check_file(out, force)
