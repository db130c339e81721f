"""`gsedit diff`: how two scenes differ, in numbers and as a picture."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gsedit.storage.inputs import existing_file
from rasterizer.numerics import Execution, Numerics

from ..core.command import Settings, Values, argument, option, with_values
from ..core.console import print_json, print_message, shown
from ..core.kernel import say_kernel
from ..core.outputs import check_file
from ..core.progress import counting
from ..options.cameras import ViewOptions, resolve_cameras
from ..options.common import Common, Reads, Scene, Writes, load_file, numerics_of, scene_file
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
    values: Annotated[Values, Settings(render_settings)],
    common: Common,
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
    common.apply()

    from gsedit.toolkit.differences import QUANTILES, difference_table
    from gsedit.toolkit.differences import diff as compared

    pair = read_pair((scene, other), own, cameras, with_values(Execution(), values))
    seen = {"numerics": pair.numerics, "execution": pair.execution}
    with counting("compare", as_json=common.json) as tell:
        result = compared(*pair.scenes, pair.viewpoints, **seen, progress=tell)
    if own.out is not None:
        draw(result, pair, own.out, own.force)
        print_message(f"the picture is {own.out}")
    if common.json:
        record = {**asdict(result), "quantiles": QUANTILES, "worst_view": result.worst.name}
        print_json("diff", {"files": [scene, other], **record})
    else:
        typer.echo(shown(difference_table(result, (scene, other))))


def read_pair(
    paths: tuple[Path, Path], own: DiffOptions, cameras: ViewOptions, execution: Execution
) -> Pair:
    """Read both scenes, and place the views."""
    before, after = (load_file(path, drop_invalid=own.drop_invalid) for path in paths)
    say_kernel(execution)
    return Pair(
        paths,
        (before.scene, after.scene),
        (numerics_of(before, paths[0]), numerics_of(after, paths[1])),
        views_of(*paths, before.scene, cameras, own.count, execution),
        execution,
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
