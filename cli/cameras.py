"""Where views are taken from: a dataset, the cameras recorded beside a scene, or found ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import print_message
from .options import Data, Size

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.views.dataset import Dataset
    from gsedit.views.search import Wish
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians

Up = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="AXIS",
        show_default="from the ground that views see, else -y",
        help="World axis that points up: x, -x, y, -y, z or -z. Cameras beside the scene are then "
        "left aside.",
    ),
]
LookAt = Annotated[
    str | None,
    typer.Option(
        "--look-at",
        metavar="X,Y,Z",
        show_default="found",
        help="Point that the views look at. Cameras beside the scene are then left aside.",
    ),
]
From = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="X,Y,Z",
        show_default="found",
        help="Point that the views are taken from, or from beside it. Cameras beside the scene are "
        "then left aside.",
    ),
]


@dataclass(frozen=True)
class ViewOptions:
    """The cameras of a verb that needs several."""

    data: Data = None
    size: Size = 256
    up: Up = None
    look_at: LookAt = None
    eye: From = None

    @property
    def placed(self) -> bool:
        """Whether the views are to be found, even where a capture's cameras are known."""
        return not (self.up is None and self.look_at is None and self.eye is None)

    def check(self) -> None:
        """Raise UsageError for a name that is no axis, a text that is no point, or points beside
        photos: before a large file is read.
        """
        from gsedit.errors import UsageError

        wish_of(self)
        if self.data is not None and (self.look_at or self.eye):
            raise UsageError("--look-at and --from place cameras: leave out --data")


def wish_of(options: ViewOptions) -> Wish:
    """What the options say of the views to find. Raises UsageError."""
    from gsedit.views.search import Wish

    eye, target = point(options.eye, "--from"), point(options.look_at, "--look-at")
    return Wish(up_vector(options.up), target, eye)


def point(text: str | None, option: str) -> Tensor | None:
    """Three finite numbers separated by commas, float64. Raises UsageError."""
    if text is None:
        return None
    import torch

    from gsedit.errors import UsageError

    try:
        numbers = torch.tensor([float(part) for part in text.split(",")], dtype=torch.float64)
    except ValueError:
        numbers = torch.zeros(0)
    if numbers.shape != (3,) or not numbers.isfinite().all():
        raise UsageError(f"{option} {text}: give three numbers separated by commas, as in 0,1.5,-2")
    return numbers


def up_vector(up: str | None) -> Tensor | None:
    """The unit vector of an axis name; None where the library is to find it from the scene."""
    if up is None:
        return None
    from gsedit.views import framing

    return framing.up_vector(up)


def load_photos(data: Path, size: int, scene: Path | None) -> Dataset:
    """The photos of --data, in the frame of the scene file where nerfstudio exported that."""
    from gsedit.files import load_dataset
    from gsedit.files.export_frame import in_export_frame

    photos = load_dataset(data, size=size)
    say_notes(photos)
    say_if_smaller(photos, size)
    return photos if scene is None else in_export_frame(photos, data, scene)


def say_notes(photos: Dataset) -> None:
    """What a person should know of how photos were read, a line each."""
    for note in photos.notes:
        print_message(note)


def framed_alike(dataset: Dataset) -> Dataset:
    """The views in pictures of one size, with a line where they had several."""
    from gsedit.views.kept import of_one_size

    framed = of_one_size(dataset)
    if framed is not dataset:
        print_message(framed.notes[-1])
    return framed


def say_if_smaller(photos: Dataset, size: int) -> None:
    """A line where all photos have fewer pixels than were asked for: they are not made larger."""
    width, height = max(((v.camera.width, v.camera.height) for v in photos.views), key=max)
    if max(width, height) < size:
        print_message(
            f"the photos have {width}x{height} pixels: views are not made larger (--size {size})"
        )


def recorded_viewpoints(path: Path | None, scene: Gaussians, size: int) -> tuple[Viewpoint, ...]:
    """All cameras recorded beside a scene file; none where there are none, or none sees it."""
    from gsedit.files.cameras import cameras_file, read_cameras
    from gsedit.views.viewpoints import same_size, that_see, thinned

    file = None if path is None else cameras_file(path)
    if file is None:
        return ()
    viewpoints = same_size(read_cameras(file), size)
    if not that_see(thinned(viewpoints, 16), scene):
        print_message(f"{file}: none of these cameras sees the scene; they are left aside")
        return ()
    print_message(f"views are taken from the {len(viewpoints)} cameras of {file}")
    return viewpoints


def rendered_where_seen(
    viewpoints: Sequence[Viewpoint], scene: Gaussians, execution: Execution
) -> Dataset:
    """Renders from those of the recorded cameras that see the scene; of many, of some."""
    from gsedit.views.viewpoints import rendered, that_see, thinned

    some = thinned(viewpoints)
    seeing = that_see(some, scene, execution)
    if len(seeing) < len(some):
        print_message(f"{len(some) - len(seeing)} cameras see nothing: they are left out")
    return rendered(scene, seeing, execution)


def load_views(
    path: Path | None, scene: Gaussians, options: ViewOptions, execution: Execution
) -> Dataset:
    """The views of an edit: photos of --data, or renders from recorded or found cameras; of a scene
    that is no longer as its file has it, the path is None."""
    if options.data is not None:
        return load_photos(options.data, options.size, path)
    from gsedit.edit import around

    if not options.placed and (recorded := recorded_viewpoints(path, scene, options.size)):
        return rendered_where_seen(recorded, scene, execution)
    print_message("views are searched for in the scene; a cameras.json beside it saves this")
    wish = wish_of(options)
    return around(
        scene, options.size, wish.up, look_at=wish.look_at, eye=wish.eye, execution=execution
    )
