"""The cameras of a verb that shows a scene: of photos, recorded beside the scene, or found once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .cameras import (
    ViewOptions,
    load_photos,
    recorded_viewpoints,
    rendered_where_seen,
    wish_of,
)
from .console import print_message

if TYPE_CHECKING:
    from gsedit.views.dataset import Dataset
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.camera import Camera
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Placed:
    """Viewpoints of one scene, and the photos that were taken there, if any."""

    viewpoints: tuple[Viewpoint, ...]
    photos: Dataset | None = None
    found: bool = False
    """Whether they were searched for: they have no names of photos then."""

    def named(self, indices: Sequence[int]) -> dict[str, Camera]:
        """Cameras by the names of their pictures, of the view's number and its photo's name.
        Raises UsageError for a number that there is not.
        """
        from gsedit.errors import UsageError

        cameras = {}
        for index in indices:
            if not 0 <= index < len(self.viewpoints):
                last = len(self.viewpoints) - 1
                raise UsageError(f"--views {index}: there are views 0 to {last}")
            viewpoint = self.viewpoints[index]
            name = viewpoint.name if self.found else f"{index:03d}_{Path(viewpoint.name).stem}"
            cameras[name] = viewpoint.camera
        return cameras

    def dataset(self, scene: Gaussians, execution: Execution) -> Dataset:
        """The views with pictures: the photos, or renders; of many recorded cameras, of some."""
        from gsedit.views.viewpoints import rendered

        if self.photos is not None:
            return self.photos
        if self.found:
            return rendered(scene, self.viewpoints, execution)
        return rendered_where_seen(self.viewpoints, scene, execution)


def place(
    path: Path, scene: Gaussians, options: ViewOptions, count: int, execution: Execution
) -> Placed:
    """All cameras of --data, or those recorded beside the scene, or else `count` found ones."""
    from gsedit.views.choose import find_views, view_names
    from gsedit.views.coarse import coarsen
    from gsedit.views.viewpoints import Viewpoint, viewpoints_of

    if options.data is not None:
        photos = load_photos(options.data, options.size, path)
        return Placed(viewpoints_of(photos), photos)
    if not options.placed and (recorded := recorded_viewpoints(path, scene, options.size)):
        return Placed(recorded)
    print_message("views are searched for in the scene; a cameras.json beside it saves this")
    coarse = coarsen(scene)
    looked_at = scene if coarse is None else coarse.scene
    found = find_views(looked_at, count, options.size, wish=wish_of(options), execution=execution)
    return Placed(tuple(map(Viewpoint, view_names(len(found)), found)), found=True)
