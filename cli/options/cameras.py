"""Cameras of views: those of a dataset, those recorded beside a scene, or found ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option
from ..core.console import print_message
from .common import Data, numbers

if TYPE_CHECKING:
    from torch import Tensor

    from gsedit.views.dataset import Dataset
    from gsedit.views.search import ViewConstraints
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

VIEW_PIXELS = 256
"""Longer side of views where --size is not given."""


@dataclass(frozen=True)
class Placing(Data):
    """Cameras of a capture, or points and an axis that place cameras."""

    up: str | None = option(None, "AXIS")
    """World axis that points up: x, -x, y, -y, z or -z. Cameras beside the scene are then ignored.
    None: from the ground that views see, else -y."""
    look_at: str | None = option(None, "X,Y,Z")
    """Point that the views look at. Cameras beside the scene are then ignored. None: found."""
    eye: str | None = option(None, "X,Y,Z", flags="--from")
    """Point that the views are taken from, or from beside it. Cameras beside the scene are then
    ignored. None: found."""

    @property
    def placed(self) -> bool:
        """Whether an option says where views are taken from, even where cameras are known."""
        return not (self.up is None and self.look_at is None and self.eye is None)

    def wish(self) -> ViewConstraints:
        """Return the constraints on views. Raises UsageError for what is no axis or no point."""
        from gsedit.scene.framing import up_vector
        from gsedit.views.search import ViewConstraints

        up = None if self.up is None else up_vector(self.up)
        return ViewConstraints(up, point(self.look_at, "--look-at"), point(self.eye, "--from"))


@dataclass(frozen=True)
class ViewOptions(Placing):
    """The cameras of a verb that needs several."""

    size: int | None = option(None, "PIXELS", min=16)
    """Longer side of the views. None: 256."""

    @property
    def pixels(self) -> int:
        """Longer side of the views, with its default."""
        return self.size or VIEW_PIXELS

    def check(self) -> None:
        """Raise UsageError for a name that is no axis, a text that is no point, or points beside
        photos: before a large file is read."""
        self.wish()
        if self.data is not None and (self.look_at or self.eye):
            raise UsageError("--look-at and --from place cameras: leave out --data")


def point(text: str | None, option: str) -> Tensor | None:
    """Three numbers of a scene's size separated by commas, float64. Raises UsageError."""
    if text is None:
        return None
    import torch

    from gsedit.formats.limits import MAX_POSITION

    found = torch.tensor(numbers(option, text, 3), dtype=torch.float64)
    if found.abs().max() > MAX_POSITION:
        raise UsageError(f"{option} {text:.80}: no scene reaches beyond {MAX_POSITION:g}")
    return found


def load_photos(data: Path, size: int, scene: Path | None) -> Dataset:
    """Load the photos of --data, in the frame of the scene file if nerfstudio exported it."""
    from gsedit.views.export_frame import in_export_frame
    from gsedit.views.load import load_dataset

    photos = load_dataset(data, size=size)
    for note in photos.notes:
        print_message(note)
    return photos if scene is None else in_export_frame(photos, data, scene)


def say_if_smaller(photos: Dataset, size: int) -> None:
    """Print a line where all photos are smaller than the requested size."""
    width, height = max(((v.camera.width, v.camera.height) for v in photos.views), key=max)
    if max(width, height) < size:
        print_message(
            f"the photos have {width}x{height} pixels: views are not made larger (--size {size})"
        )


def recorded(path: Path | None, scene: Gaussians, size: int) -> tuple[Viewpoint, ...]:
    """Return all cameras recorded beside a scene file; none if none of them sees the scene."""
    from gsedit.views.cameras_json import cameras_file, recorded_viewpoints

    file = None if path is None else cameras_file(path)
    found = recorded_viewpoints(scene, file, size)
    if found:
        print_message(f"views are taken from the {len(found)} cameras of {file}")
    elif file is not None:
        print_message(f"{file}: none of these cameras sees the scene; they are ignored")
    return found


def resolve_cameras(
    path: Path | None, scene: Gaussians, options: ViewOptions, count: int | None = None
) -> ResolvedCameras:
    """Return the cameras of --data, or those recorded beside the scene, or else `count` found; as
    many as in every verb without it, so that --at names the same pixels."""
    from gsedit.views.around import FOUND_VIEWS, find_viewpoints
    from gsedit.views.viewpoints import thinned

    known = known_cameras(path, scene, options)
    if known is not None:
        return known
    print_message("searching the scene for views; a cameras.json beside it saves this")
    found = find_viewpoints(scene, count or FOUND_VIEWS, options.pixels, wish=options.wish())
    say_if_empty(thinned(found, 8), scene)
    return ResolvedCameras(found, found=True)


def known_cameras(
    path: Path | None, scene: Gaussians, options: ViewOptions
) -> ResolvedCameras | None:
    """Return the cameras of --data, or those recorded beside the scene; None without any."""
    from gsedit.views.viewpoints import viewpoints_of

    if options.data is not None:
        photos = load_photos(options.data, options.pixels, path)
        say_if_smaller(photos, options.pixels)
        return ResolvedCameras(viewpoints_of(photos), photos)
    found = () if options.placed else recorded(path, scene, options.pixels)
    return ResolvedCameras(found) if found else None


def say_if_empty(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> None:
    """Print a line where found views show nothing of the scene."""
    from gsedit.views.viewpoints import that_see

    empty = len(viewpoints) - len(that_see(viewpoints, scene))
    if empty:
        print_message(
            f"{empty} of {len(viewpoints)} found views show nothing of the scene: its Gaussians "
            "are transparent, too small or too far apart; gsedit info tells, --from and --look-at "
            "choose another view"
        )


@dataclass(frozen=True, eq=False)
class ResolvedCameras:
    """Viewpoints of one scene, and the photos that were taken there, if any."""

    viewpoints: tuple[Viewpoint, ...]
    photos: Dataset | None = None
    found: bool = False
    """Whether they were searched for: they have no names of photos then."""

    def named(self, indices: Sequence[int]) -> dict[str, Camera]:
        """Cameras by the names of their pictures, of the view's number and its photo's name.
        Raises UsageError for a number that there is not."""
        cameras = {}
        for index in indices:
            if not 0 <= index < len(self.viewpoints):
                last = len(self.viewpoints) - 1
                raise UsageError(f"--views {index}: there are views 0 to {last}")
            viewpoint = self.viewpoints[index]
            name = viewpoint.name if self.found else f"{index:03d}_{Path(viewpoint.name).stem}"
            cameras[name] = viewpoint.camera
        return cameras

    def some(self, scene: Gaussians) -> Sequence[Viewpoint]:
        """The found viewpoints; of many recorded ones some, without those that see nothing."""
        from gsedit.views.viewpoints import that_see, thinned

        if self.found:
            return self.viewpoints
        some = thinned(self.viewpoints)
        seeing = that_see(some, scene)
        if len(seeing) < len(some):
            print_message(f"{len(some) - len(seeing)} cameras see nothing: they are skipped")
        return seeing
