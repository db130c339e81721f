"""Named cameras from which a scene is looked at: brought to one size, thinned, checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

import torch

from gsedit.errors import UsageError
from gsedit.scene.framing import NEAR_SHARE, bounds
from gsedit.views.dataset import Dataset, capture
from gsedit.views.undistort import Lens
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT
from rasterizer.render import render
from rasterizer.scene import Gaussians

AT_MOST = 64
"""Viewpoints that an edit surveys, of a capture that has more: each costs two renders."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera with the name of its photo or view."""

    name: str
    camera: Camera
    lens: Lens | None = None
    """Lens of the photo as it was taken; None: not known."""


Views = Dataset | Sequence[Viewpoint]
"""Photos with cameras, or cameras alone."""


def viewpoints_of(views: Views) -> tuple[Viewpoint, ...]:
    """The cameras of views, with their names."""
    if not isinstance(views, Dataset):
        return tuple(views)
    return tuple(Viewpoint(view.name, view.camera, view.lens) for view in views.views)


def view_named(views: Sequence[Viewpoint], name: str) -> Viewpoint:
    """The view of a name, of the end of one with or without its suffix, or of a number from 0.

    Raises UsageError for none or several.
    """
    exact = [each for each in views if each.name == name]
    ends = [each for each in views if name in (Path(each.name).name, Path(each.name).stem)]
    found = exact or ends
    if not found and name.isdecimal() and int(name) < len(views):
        found = [views[int(name)]]
    if len(found) == 1:
        return found[0]
    if not views:
        raise UsageError(f"there is no view {name!r}, as there are no cameras: add --data")
    if found:
        raise UsageError(f"several views are named {name!r}: give its number from 0")
    names = [each.name for each in views]
    near = get_close_matches(name, names, 1)
    hint = f"did you mean {near[0]}?" if near else f"the first is {names[0]}"
    raise UsageError(
        f"no view is named {name!r}: {hint} (numbers 0 to {len(views) - 1} name them too)"
    )


def framed(camera: Camera, width: int, height: int) -> Camera:
    """The pose on another picture, which shows all that the camera showed, in the middle."""
    scale = min(width / camera.width, height / camera.height)
    return replace(
        camera,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=width / 2,
        cy=height / 2,
        width=width,
        height=height,
    )


def same_size(viewpoints: Sequence[Viewpoint], size: int) -> tuple[Viewpoint, ...]:
    """All on pictures whose longer side is `size` pixels, in the most frequent proportions; those
    that have them keep their principal point, so that they show what their photo shows."""
    shapes = Counter((v.camera.width, v.camera.height) for v in viewpoints)
    common, _ = shapes.most_common(1)[0]
    scale = size / max(common)
    width, height = (max(1, round(side * scale)) for side in common)
    cameras = (
        camera.resized(width, height)
        if (camera.width, camera.height) == common
        else framed(camera, width, height)
        for camera in (viewpoint.camera for viewpoint in viewpoints)
    )
    return tuple(replace(v, camera=camera) for v, camera in zip(viewpoints, cameras))


def thinned(viewpoints: Sequence[Viewpoint], at_most: int = AT_MOST) -> tuple[Viewpoint, ...]:
    """Every k-th viewpoint from the first, with the least k that leaves `at_most`.

    A whole k: every 8th of what is left, which an edit holds out, is an 8th of all, which the fit
    held out.
    """
    return tuple(viewpoints[:: -(-len(viewpoints) // at_most)])


@torch.no_grad()
def that_see(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> tuple[Viewpoint, ...]:
    """Those whose picture shows something of the scene: cameras of another scene do not."""
    some = scene[:: 1 + len(scene) // 10_000]  # what shows enough of these shows no less of all

    def sees(camera: Camera) -> bool:
        # a camera of another scene, or frame, sees less
        return any(float(render(each, camera).alpha.mean()) >= 0.01 for each in (some, scene))

    return tuple(each for each in viewpoints if sees(each.camera.fitted(32)))


def rendered(scene: Gaussians, viewpoints: Sequence[Viewpoint]) -> Dataset:
    """Renders of the scene as a dataset: what an edit works on where there are no photos."""
    cameras, names = [v.camera for v in viewpoints], [v.name for v in viewpoints]
    return Dataset(capture(scene.detach(), cameras, names))


def viewpoints_near(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> tuple[Viewpoint, ...]:
    """Give recorded cameras a nearer near plane where the scene's units need one.

    They keep 0.01 unless that is more than a twentieth of the radius of the scene's bulk. Raises
    UsageError for an empty scene.
    """
    near = _needed(bounds(scene).radius)
    if near is None:
        return tuple(viewpoints)
    return tuple(replace(each, camera=replace(each.camera, near=near)) for each in viewpoints)


def dataset_near(dataset: Dataset) -> Dataset:
    """Give the cameras of photos a nearer near plane where the units of the sparse points need one.

    Without points, all stays.
    """
    if dataset.points is None or not len(dataset.points):
        return dataset
    distance = (dataset.points - dataset.points.median(0).values).norm(dim=-1)
    near = _needed(float(distance.median()))
    if near is None:
        return dataset
    views = tuple(view.seen_by(replace(view.camera, near=near)) for view in dataset.views)
    return replace(dataset, views=views)


def _needed(radius: float) -> float | None:
    """None where the renderer's own near plane does, and where a scene has no extent."""
    too_far = 0 < radius < torch.inf and DEFAULT.near > 0.05 * radius
    return NEAR_SHARE * radius if too_far else None
