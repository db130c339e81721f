"""`gsedit measure`: distances, heights, areas and volumes of what a scene shows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

from ..core.command import option, shows
from ..core.console import print_message, print_result
from ..options.cameras import ViewOptions
from ..options.common import Common, DropInvalid, Scene, load_scene
from ..options.pointing import views_to_point_at

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.surveying.sizes import Size, SurfacePoint
    from rasterizer.scene import Gaussians

COORDINATES = re.compile(r"\s*-?[\d.]+(e-?\d+)?\s*(,\s*-?[\d.]+(e-?\d+)?\s*){2}", re.IGNORECASE)


@dataclass(frozen=True)
class MeasureOptions:
    """Options of `gsedit measure` alone."""

    at: list[str] | None = option(
        None,
        "Point on the surface: a pixel of a view, as in frame_00012.jpg:130,80, or X,Y,Z; "
        "repeatable. Column and row of the view at --size.",
        "VIEW:X,Y|X,Y,Z",
    )
    height: bool = option(False, "Height of each point above the ground instead.")
    region: str | None = option(
        None, "Volume of a selection: a name of gsedit select --as, or as in gsedit edit.", "REGION"
    )
    data: Path | None = option(None, "Folder of posed photos, or a cameras.json.", "DATASET")
    size: int | None = option(
        None, "Longer side of the views that --at counts in.", "PIXELS", min=16, show_default="256"
    )


@shows("--at", "--height", "--region", "--data", "--size", "--json")
def measure(
    scene: Scene, drop_invalid: DropInvalid = False, *, own: MeasureOptions, common: Common
) -> None:
    """Measure distances, heights, areas and volumes, each with its uncertainty.

    gsedit measure scene.ply --at 0:130,80 --at 0:170,82

    gsedit measure bear.ply --at frame_00001.jpg:130,80 --height

    gsedit measure bear.ply --region bear

    Two points: their distance. Three and more: the area of the polygon. The interval joins
    the size of a pixel, and how far other views disagree about the place.
    """
    from gsedit.select.where import place_of

    points = own.at or []
    if bool(points) == (own.region is not None):
        raise UsageError("name points with --at, or a selection with --region")
    if len(points) == 1 and not own.height:
        raise UsageError("one point: add --at for a distance, or --height for the one above ground")
    for text in points:
        if not COORDINATES.fullmatch(text):
            place_of(text)
    common.apply()
    gaussians = load_scene(scene, drop_invalid=drop_invalid).detach()
    typed = points and not own.height and all(COORDINATES.fullmatch(text) for text in points)
    options = ViewOptions(data=own.data, size=own.size)
    views = () if typed else views_to_point_at(scene, gaussians, options)
    if own.region is not None:
        return tell(scene, {"volume": region_volume(scene, gaussians, own.region, views)}, common)
    found = [point(text, gaussians, views) for text in points]
    tell(scene, sizes(gaussians, found, views, height=own.height), common, found)


def point(text: str, gaussians: Gaussians, views: Sequence[Viewpoint]) -> SurfacePoint:
    """Return the point at a place. Raises UsageError."""
    import numpy as np

    from gsedit.select.finder import click_on
    from gsedit.select.where import place_of
    from gsedit.surveying.sizes import SurfacePoint, point_at

    if COORDINATES.fullmatch(text):
        return SurfacePoint(np.array([float(each) for each in text.split(",")]))
    found = click_on(views, *place_of(text))
    return point_at(gaussians, found.camera, found.x, found.y, [each.camera for each in views])


def sizes(
    gaussians: Gaussians,
    points: Sequence[SurfacePoint],
    views: Sequence[Viewpoint],
    *,
    height: bool,
) -> dict[str, Size]:
    """Return what the points measure, by name."""
    from gsedit.cameras.paths import up_of
    from gsedit.surveying import sizes as surveying

    if height:
        upward = up_of([each.camera for each in views]).numpy()
        ground, sigma = surveying.ground_of(gaussians, upward)
        names = [f"height {i}" for i in range(1, len(points) + 1)] if points[1:] else ["height"]
        found = [surveying.height(each, ground, sigma) for each in points]
        return dict(zip(names, found, strict=True))
    if len(points) == 2:
        return {"distance": surveying.distance(*points)}
    return {"area": surveying.area(points)}


def region_volume(
    scene: Path, gaussians: Gaussians, region: str, views: Sequence[Viewpoint]
) -> Size:
    """Return the volume of a selection. Raises UsageError."""
    from gsedit.select.finder import Finder
    from gsedit.select.saved import saved_file
    from gsedit.surveying.sizes import volume

    found = Finder(gaussians, views, str(saved_file(scene, region) or region)).subject
    return volume(gaussians, [each.camera for each in views], found.inside)


def tell(
    scene: Path, found: dict[str, Size], common: Common, points: Sequence[SurfacePoint] = ()
) -> None:
    """Print the sizes, and how the scale is set from a known one."""
    for number, each in enumerate(points, 1):
        print_message(f"point {number}: {_listed(each)}, known to {each.sigma:.3g}")
    if len(points) == 2 and "distance" in found:
        ends = ",".join(f"{value:.6g}" for each in points for value in each.position)
        print_message(f"if you know it: gsedit align {scene} --length={ends}=LENGTH -o scaled.ply")
    record: dict[str, Any] = {
        name: {"value": size.value, "sigma": size.sigma, "interval_95": list(size.interval)}
        for name, size in found.items()
    }
    record["points"] = [
        {"position": p.position.tolist(), "sigma": p.sigma, "views": p.views} for p in points
    ]
    text = "\n".join(f"{name}: {size}" for name, size in found.items())
    print_result(record, text, as_json=common.json)


def _listed(point: SurfacePoint) -> str:
    return ", ".join(f"{value:.5g}" for value in point.position)
