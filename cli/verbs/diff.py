"""`gsedit diff`: how two scenes differ, in numbers and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gsedit.storage.inputs import existing_file
from rasterizer.numerics import Execution, Numerics

from ..core.command import argument, option, output
from ..core.console import print_json, print_message, shown
from ..core.kernel import say_kernel
from ..core.outputs import check_file
from ..core.progress import counting
from ..options.cameras import ViewOptions, resolve_cameras
from ..options.common import (
    Common,
    DropInvalid,
    Force,
    Scene,
    load_file,
    numerics_of,
    scene_file,
)
from ..options.settings import SettingsGroup, Values, with_values
from .render import render_settings

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.toolkit.differences import SceneDifference
    from rasterizer.scene import Gaussians

PICTURED_VIEWS = 4
"""Most views in the picture: the worst one first."""

Other = Annotated[
    Path,
    argument(
        "OTHER",
        "The scene to compare with the first, or the folder of an edit.",
        callback=scene_file,
    ),
]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two scenes, and how they are looked at."""

    paths: tuple[Path, Path]
    scenes: tuple[Gaussians, Gaussians]
    numerics: tuple[Numerics, Numerics]
    viewpoints: tuple[Viewpoint, ...]
    execution: Execution


@dataclass(frozen=True)
class DiffOptions:
    """Options of `gsedit diff` alone."""

    out: Path | None = output(None, "PNG to write: both scenes and their difference.")
    count: int = option(8, "Views to compare from, evenly spaced.", min=1)


def diff(
    scene: Scene,
    other: Other,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    own: DiffOptions,
    cameras: ViewOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Compare two scenes: counts, attributes, PSNR and SSIM.

    gsedit diff before.ply after.ply -o diff.png

    The cameras come from --data, else from a cameras.json beside either scene, else from
    viewpoints that gsedit finds.
    """
    check_request((scene, other), own.out, cameras, force)
    common.apply()

    execution = with_values(Execution(), values)
    pair = read_pair((scene, other), cameras, own.count, execution, drop_invalid=drop_invalid)
    result = compare(pair, as_json=common.json)
    if own.out is not None:
        draw(result, pair, own.out, force)
        print_message(f"the picture is {own.out}")
    show_result(result, (scene, other), as_json=common.json)


def read_pair(
    paths: tuple[Path, Path],
    cameras: ViewOptions,
    count: int,
    execution: Execution,
    *,
    drop_invalid: bool,
) -> Pair:
    """Read both scenes, and place the views."""
    before, after = (load_file(path, drop_invalid=drop_invalid) for path in paths)
    say_kernel(execution)
    return Pair(
        paths,
        (before.scene, after.scene),
        (numerics_of(before, paths[0]), numerics_of(after, paths[1])),
        views_of(*paths, before.scene, cameras, count, execution),
        execution,
    )


def show_result(result: SceneDifference, paths: tuple[Path, Path], *, as_json: bool) -> None:
    """Print the comparison on stdout."""
    if as_json:
        print_json("diff", {"files": list(paths), **as_record(result)})
    else:
        from gsedit.toolkit.differences import difference_table

        typer.echo(shown(difference_table(result, paths)))


def check_request(
    scenes: tuple[Path, Path], out: Path | None, cameras: ViewOptions, force: bool
) -> None:
    """Raise UsageError for options that make no sense, and InputError for a file that is not there,
    before large files are read."""
    cameras.check()
    check_file(out, force, ".png")
    for path in scenes:
        if not path.is_dir():  # a scene may be a folder; the reader says what is wrong with it
            existing_file(path)


def compare(pair: Pair, *, as_json: bool) -> SceneDifference:
    """The comparison, its progress shown."""
    from gsedit.toolkit.differences import diff

    numerics, execution = pair.numerics, pair.execution
    with counting("compare", as_json=as_json) as tell:
        return diff(
            *pair.scenes, pair.viewpoints, numerics=numerics, execution=execution, progress=tell
        )


def views_of(
    scene: Path,
    other: Path,
    gaussians: Gaussians,
    options: ViewOptions,
    count: int,
    execution: Execution,
) -> tuple[Viewpoint, ...]:
    """`count` of the cameras to compare from: those beside the second scene where only that one has
    some."""
    from gsedit.datasets.cameras_json import cameras_file
    from gsedit.datasets.dataset import evenly_spaced

    beside = other if not cameras_file(scene) and cameras_file(other) else scene
    resolved = resolve_cameras(beside, gaussians, options, count, execution)
    chosen = evenly_spaced(len(resolved.viewpoints), count)
    return tuple(resolved.viewpoints[index] for index in chosen)


def draw(result: SceneDifference, pair: Pair, out: Path, force: bool) -> None:
    """Write the picture: the worst view, and evenly spaced ones of the others."""
    from gsedit.datasets.dataset import evenly_spaced
    from gsedit.pictures.difference_picture import Pair as Pictures
    from gsedit.pictures.difference_picture import difference_picture
    from gsedit.scene.picture import render_picture

    worst = result.views.index(result.worst)
    others = [index for index in range(len(result.views)) if index != worst]
    chosen = [worst, *(others[i] for i in evenly_spaced(len(others), PICTURED_VIEWS - 1))]
    pairs = []
    for index in chosen:
        view, camera = result.views[index], pair.viewpoints[index].camera
        title = (
            f"{Path(view.name).stem[:24]}: {view.psnr:.1f} dB{' (worst)' if index == worst else ''}"
        )
        before, after = (
            render_picture(scene, camera, pair.execution, own)
            for scene, own in zip(pair.scenes, pair.numerics)
        )
        pairs.append(Pictures(title, before, after))
    names = pair.paths[0].name, pair.paths[1].name
    difference_picture(pairs, names, out, overwrite=force)


def as_record(result: SceneDifference) -> dict[str, object]:
    """The comparison for JSON."""
    from dataclasses import asdict

    from gsedit.toolkit.differences import QUANTILES

    return {**asdict(result), "quantiles": QUANTILES, "worst_view": result.worst.name}
