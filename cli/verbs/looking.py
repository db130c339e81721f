"""Verbs that look at a scene and measure it: info, diff, measure, mesh."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gsedit.errors import UsageError
from gsedit.run.inputs import existing_file
from rasterizer.numerics import Execution, Numerics

from ..core.command import Values, argument, option, shows, with_values
from ..core.console import as_json, print_json, print_message, print_result, shown
from ..core.kernel import say_kernel
from ..core.outputs import check_file
from ..core.progress import counting
from ..options.cameras import ViewOptions, known_cameras, resolve_cameras
from ..options.common import (
    FileOptions,
    Reads,
    Scene,
    Writes,
    load_file,
    load_scene,
    numerics_of,
    scene_file,
)
from ..options.selection import SelectionOptions
from .render import RENDER_SETTINGS

if TYPE_CHECKING:
    from gsedit.formats.streams import SceneSource
    from gsedit.mesh.sizes import Size, SurfacePoint
    from gsedit.toolkit.differences import SceneDifference
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.scene import Gaussians

COORDINATES = re.compile(r"\s*-?[\d.]+(e-?\d+)?\s*(,\s*-?[\d.]+(e-?\d+)?\s*){2}", re.IGNORECASE)

Other = Annotated[
    Path,
    argument(
        "OTHER",
        "The scene to compare with the first, or the folder of an edit.",
        callback=scene_file,
    ),
]


@dataclass(frozen=True)
class InfoOptions:
    """How a scene file is shown, or checked for defects."""

    check: bool = option(False)
    """List every defect instead, with its rows and the command that mends it."""
    quick: bool = option(False)
    """--check: only defects of single rows, for files larger than memory."""
    strict: bool = option(False)
    """--check: exit code 1 for any defect, not only for invalid rows."""


def info(scene: Scene, *, checks: InfoOptions, files: FileOptions) -> None:
    """Show what a scene file holds, or with --check its defects.

    gsedit info scene.ply

    gsedit info scene.ply --check

    --check also reads files that other commands refuse. Its exit code is 1 where rows are invalid
    (NaN, Inf, a rotation of length 0) and 0 otherwise: floaters, needles and the like are no
    error. docs/howto/clean.md explains every criterion and its threshold.
    """
    from gsedit.formats.files import open_scene

    if not checks.check and (checks.quick or checks.strict):
        raise UsageError("--quick and --strict belong to --check: add it")
    source = open_scene(scene, files.read())
    if checks.check:
        check_scene(scene, source, checks)
    else:
        show_summary(scene, source)


def show_summary(scene: Path, source: SceneSource) -> None:
    """Print the summary of a scene."""
    from gsedit.toolkit.scene_summary import summarise, summary_table

    (summary, _), size = summarise(source), bytes_of(source.path)
    record = {"file": scene, "bytes": size, **of_file(source), **asdict(summary)}
    print_result(record, summary_table(source, size, summary))


def check_scene(scene: Path, source: SceneSource, checks: InfoOptions) -> None:
    """Print the defects of a scene. Exits with 1 where rows are invalid, or for any if strict."""
    from gsedit.toolkit.defects import check, defect_record, defect_table

    for note in source.notes:
        print_message(f"{scene}: {note}")
    report = check(source, quick=checks.quick)
    record = {"file": scene, "format": source.format, **defect_record(report)}
    text = defect_table(scene, source.format, report, checks.quick)
    print_result(record, text)
    if report.refused or (checks.strict and report.found):
        raise typer.Exit(1)


def bytes_of(path: Path) -> int:
    """Return the size of a file, or of the folder of a SOG scene that it is the index of."""
    from gsedit.formats.registry import INDEX

    files = path.parent.rglob("*") if path.name == INDEX else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def of_file(source: SceneSource) -> dict[str, Any]:
    """Return the facts that hold for the whole file."""
    header = source.header
    return {
        "format": source.format,
        "extra": {name: str(kind) for name, kind in header.extra.items()},
        "elements": {name: len(rows) for name, rows in header.elements.items()},
        "comments": header.comments,
        "antialiased": header.antialiased,
        "notes": source.notes,
    }


@dataclass(frozen=True)
class DiffOptions(Reads, Writes):
    """Options of `gsedit diff` alone."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """PNG to write: both scenes and their difference."""
    count: int = option(8, min=1)
    """Views to compare from, evenly spaced."""


def diff(
    scene: Scene,
    other: Other,
    *,
    own: DiffOptions,
    cameras: ViewOptions,
    values: Annotated[Values, RENDER_SETTINGS],
) -> None:
    """Compare two scenes: counts, attributes, PSNR and SSIM.

    gsedit diff before.ply after.ply -o diff.png

    The cameras come from --data, else from a cameras.json beside either scene, else from
    viewpoints that gsedit finds.
    """
    cameras.check()
    check_file(own.out, own.force, ".png")
    for path in (scene, other):
        if not path.is_dir():  # a scene may be a folder; the reader says what is wrong with it
            existing_file(path)

    from gsedit.toolkit.differences import QUANTILES, difference_table
    from gsedit.toolkit.differences import diff as compared

    say_kernel(with_values(Execution(), values))
    names = scene, other
    files = [load_file(path, drop_invalid=own.drop_invalid) for path in names]
    before, after = (file.scene for file in files)
    how = numerics_of(files[0], scene), numerics_of(files[1], other)
    views = views_of(*names, before, cameras, own.count)
    with counting("compare") as tell:
        result = compared(before, after, views, numerics=how, progress=tell)
    if own.out is not None:
        draw(result, names, tuple(zip((before, after), how)), views, own)
        print_message(f"the picture is {own.out}")
    if as_json.get():
        record = {**asdict(result), "quantiles": QUANTILES, "worst_view": result.worst.name}
        print_json("diff", {"files": [scene, other], **record})
    else:
        typer.echo(shown(difference_table(result, (scene, other))))


def views_of(
    scene: Path, other: Path, gaussians: Gaussians, options: ViewOptions, count: int
) -> tuple[Viewpoint, ...]:
    """`count` of the cameras to compare from: those beside the second scene where only that one has
    some."""
    from gsedit.views.cameras_json import cameras_file
    from gsedit.views.dataset import evenly_spaced

    beside = other if not cameras_file(scene) and cameras_file(other) else scene
    resolved = resolve_cameras(beside, gaussians, options, count)
    chosen = evenly_spaced(len(resolved.viewpoints), count)
    return tuple(resolved.viewpoints[index] for index in chosen)


def draw(
    result: SceneDifference,
    names: tuple[Path, Path],
    scenes: Sequence[tuple[Gaussians, Numerics]],
    viewpoints: Sequence[Viewpoint],
    own: DiffOptions,
) -> None:
    """Write the picture: the worst view, and evenly spaced ones of the others."""
    from gsedit.pictures.contact_sheet import difference_picture
    from gsedit.views.dataset import View, evenly_spaced
    from rasterizer.render import render_picture

    worst = result.views.index(result.worst)
    others = [index for index in range(len(result.views)) if index != worst]
    chosen = [worst, *(others[i] for i in evenly_spaced(len(others), 3))]
    views = [viewpoints[index] for index in chosen]
    before, after = (
        [View(each.name, each.camera, render_picture(scene, each.camera, how)) for each in views]
        for scene, how in scenes
    )
    first = f"{names[0].name}, the worst view first: {result.worst.psnr:.1f} dB"
    assert own.out is not None
    difference_picture(before, after, (first, names[1].name), own.out, overwrite=own.force)


@dataclass(frozen=True)
class MeasureOptions(Reads):
    """Options of `gsedit measure` alone."""

    at: list[str] | None = option(None, "VIEW:X,Y|X,Y,Z")
    """Point on the surface: a pixel of a view, as in frame_00012.jpg:130,80, or X,Y,Z; repeatable.
    Column and row of the view at --size."""
    height: bool = option(False)
    """Height of each point above the ground instead."""
    region: str | None = option(None, "REGION")
    """Volume of a selection: a name of gsedit select --as, or as in gsedit edit."""
    data: Path | None = option(None, "DATASET")
    """Folder of posed photos, or a cameras.json."""
    size: int | None = option(None, "PIXELS", min=16)
    """Longer side of the views that --at counts in. None: 256."""


@shows("--at", "--height", "--region", "--data", "--size", "--json")
def measure(scene: Scene, *, own: MeasureOptions) -> None:
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
    gaussians = load_scene(scene, drop_invalid=own.drop_invalid).detach()
    typed = points and not own.height and all(COORDINATES.fullmatch(text) for text in points)
    options = ViewOptions(data=own.data, size=own.size)
    views = () if typed else resolve_cameras(scene, gaussians, options).viewpoints
    if own.region is not None:
        return tell(scene, {"volume": region_volume(scene, gaussians, own.region, views)})
    found = [point(text, gaussians, views) for text in points]
    tell(scene, sizes(gaussians, found, views, height=own.height), found)


def point(text: str, gaussians: Gaussians, views: Sequence[Viewpoint]) -> SurfacePoint:
    """Return the point at a place. Raises UsageError."""
    import numpy as np

    from gsedit.mesh.sizes import SurfacePoint, point_at
    from gsedit.select.finder import click_on
    from gsedit.select.where import place_of

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
    from gsedit.mesh import sizes as surveying
    from gsedit.views.paths import up_of

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
    from gsedit.mesh.sizes import volume
    from gsedit.select.finder import Finder
    from gsedit.select.saved import saved_file

    found = Finder(gaussians, views, str(saved_file(scene, region) or region)).subject
    return volume(gaussians, [each.camera for each in views], found.inside)


def tell(scene: Path, found: dict[str, Size], points: Sequence[SurfacePoint] = ()) -> None:
    """Print the sizes, and how the scale is set from a known one."""
    for number, each in enumerate(points, 1):
        place = ", ".join(f"{value:.5g}" for value in each.position)
        print_message(f"point {number}: {place}, known to {each.sigma:.3g}")
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
    print_result(record, text)


@dataclass(frozen=True)
class MeshOptions(Reads, Writes):
    """Options of `gsedit mesh` alone."""

    out: Path = option(..., "PATH", flags="--output -o")
    """Mesh to write: .glb, .ply, .obj or .stl."""
    faces: int = option(200_000, "N", min=4, max=20_000_000)
    """Most triangles of the mesh."""
    watertight: bool = option(False)
    """Close the surface where no view saw it too, for printing and for volumes."""


@shows("--output", "--faces", "--watertight", "--where", "--region", "--data", "--force")
def mesh(scene: Scene, *, own: MeshOptions, selection: SelectionOptions) -> None:
    """Make a mesh of what the views of a scene show.

    gsedit mesh scene.ply -o scene.glb

    gsedit mesh bear.ply --region auto --watertight --faces 50000 -o bear.stl

    Views are those of --data, those beside the scene, or found ones. Units are the scene's.
    """
    from gsedit.mesh.triangles import SUFFIXES

    if own.out.suffix.lower() not in SUFFIXES:
        raise UsageError(f"-o {own.out}: name a mesh file: {', '.join(SUFFIXES)}")
    check_file(own.out, own.force)
    chosen = selection.selection() if selection.given else None

    import torch

    from gsedit.mesh import mesh as mesh_of
    from gsedit.mesh import save_mesh
    from gsedit.scene.table import table_of

    gaussians = load_scene(scene, drop_invalid=own.drop_invalid).detach()
    inside = None if chosen is None else torch.tensor(chosen.mask(table_of(gaussians)))
    known = known_cameras(scene, gaussians, ViewOptions(data=selection.data))
    if known is None:
        print_message("searching the scene for views; cameras beside it, or of --data, are better")
    cameras = [] if known is None else [each.camera for each in known.viewpoints]
    found = mesh_of(gaussians, cameras, inside=inside, faces=own.faces, watertight=own.watertight)
    save_mesh(found, own.out, overwrite=own.force)
    closed = found.is_closed
    record = {"mesh": own.out, "vertices": len(found.vertices), "faces": len(found.faces),
              "closed": closed, "volume": found.volume if closed else None}  # fmt: skip
    print_message(f"mesh: {len(found.faces):,} triangles, {'closed' if closed else 'open'}")
    for note in found.notes:
        print_message(f"mesh: {note}")
    print_result(record, str(own.out))
