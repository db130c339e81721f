"""Views of a scene that came without cameras: viewpoints that are found, and renders from them."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.choose import find_views, view_names
from gsedit.cameras.orbit import ELEVATION
from gsedit.cameras.search import ViewConstraints
from gsedit.datasets.dataset import Dataset
from gsedit.datasets.viewpoints import Viewpoint, rendered
from gsedit.errors import UsageError
from gsedit.scene.merging.groups import coarsen
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

FOUND_VIEWS = 24
"""Views that are found for a scene without cameras."""
FOUND_SIZE_PIXELS = 256
"""Side of the pictures of found views, which are square."""


def around(
    scene: Gaussians,
    size: int = FOUND_SIZE_PIXELS,
    up: Float[Tensor, "3"] | None = None,
    *,
    look_at: Float[Tensor, "3"] | None = None,
    eye: Float[Tensor, "3"] | None = None,
    execution: Execution = AUTO,
) -> Dataset:
    """Render a scene, `size` pixels square, from where it looks as if it was captured.

    `up` (any length), the point `look_at` that views look at and the point `eye` that they are
    taken from are found where they are None (docs/reference/cameras.md). World axes.
    Raises UsageError for an `up` of no direction, or an empty scene.
    """
    if up is not None and not (up.isfinite().all() and up.any()):
        raise UsageError(f"up {up.tolist()} is no direction: three finite numbers, not all 0")
    wish = ViewConstraints(up, look_at, eye)
    found = find_viewpoints(scene, size=size, wish=wish, execution=execution)
    return rendered(scene, found, execution)


def find_viewpoints(
    scene: Gaussians,
    count: int = FOUND_VIEWS,
    size: int = FOUND_SIZE_PIXELS,
    *,
    wish: ViewConstraints | None = None,
    rings: Sequence[float] = (ELEVATION,),
    execution: Execution = AUTO,
) -> tuple[Viewpoint, ...]:
    """Find at most `count` viewpoints from which the scene looks as if it was captured.

    Pictures are `size` pixels square. A merged copy of a large scene is searched instead of it.
    Around an object alone they have the elevations `rings`, degrees.
    Raises UsageError for an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to see")
    merged = coarsen(scene)
    searched = scene if merged is None else merged.scene
    cameras = find_views(searched, count, size, wish=wish, rings=rings, execution=execution)
    return tuple(map(Viewpoint, view_names(len(cameras)), cameras))


def cameras_of(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    count: int = FOUND_VIEWS,
    size: int = FOUND_SIZE_PIXELS,
    execution: Execution = AUTO,
) -> Sequence[Camera]:
    """The cameras, or found ones where there are none: see `find_viewpoints`."""
    if cameras:
        return cameras
    found = find_viewpoints(scene, count, size, execution=execution)
    return [each.camera for each in found]
