"""`gsedit diff`: how two scenes differ, in numbers and as a picture."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import ViewOptions
from .console import print_json, print_message
from .kernel import say_kernel
from .options import (
    Common,
    DropInvalid,
    Force,
    Scene,
    check_file,
    load_file,
    numerics_of,
    output,
    scene_file,
)
from .placed import place
from .progress import progress
from .render import render_settings
from .setting_options import SettingsGroup, Values, with_values

if TYPE_CHECKING:
    from gsedit.points.differences import Matches, SceneDifference
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.numerics import Execution, Numerics
    from rasterizer.scene import Gaussians

FEW = 0.01
"""Share of the Gaussians below which those that both scenes have are there by chance."""
SHOWN = 4
"""Most views in the picture: the worst one first."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two scenes, and how they are looked at."""

    paths: tuple[Path, Path]
    scenes: tuple[Gaussians, Gaussians]
    numerics: tuple[Numerics, Numerics]
    viewpoints: tuple[Viewpoint, ...]
    execution: Execution


def diff(
    scene: Scene,
    other: Annotated[
        Path,
        typer.Argument(
            metavar="OTHER",
            help="The scene to compare with the first, or the folder of an edit.",
            show_default=False,
            callback=scene_file,
        ),
    ],
    out: Annotated[
        Path | None,
        output("PNG to write: both scenes and their difference, from the worst view and others."),
    ] = None,
    count: Annotated[
        int, typer.Option("--count", min=1, help="Views to compare from, evenly spaced.")
    ] = 8,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    cameras: ViewOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Compare two scenes: counts, attributes, shared Gaussians, PSNR and SSIM from the same
    cameras. They are those of --data, or of a cameras.json beside either scene, or found ones.

    gsedit diff before.ply after.ply -o diff.png
    """
    check_request((scene, other), out, cameras, force)
    common.apply()

    from rasterizer.numerics import Execution

    execution = with_values(Execution(), values)
    pair = read_pair((scene, other), cameras, count, execution, drop_invalid=drop_invalid)
    result = compare(pair, as_json=common.json)
    if out is not None:
        draw(result, pair, out, force)
        print_message(f"the picture is {out}")
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
        typer.echo(as_text(result, paths))


def check_request(
    scenes: tuple[Path, Path], out: Path | None, cameras: ViewOptions, force: bool
) -> None:
    """Raise UsageError for options that make no sense, and InputError for a file that is not there,
    before large files are read."""
    from gsedit.errors import UsageError
    from gsedit.files.inputs import existing_file

    cameras.check()
    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"-o {out}: name a .png file")
        check_file(out, force)
    for path in scenes:
        if not path.is_dir():  # a scene may be a folder; the reader says what is wrong with it
            existing_file(path)


def compare(pair: Pair, *, as_json: bool) -> SceneDifference:
    """The comparison, its progress shown."""
    from gsedit.points.differences import diff
    from gsedit.reports.events import Event
    from gsedit.reports.stopwatch import Stopwatch

    watch = Stopwatch()
    with progress(as_json=as_json) as show:

        def tell(done: int, total: int) -> None:
            show(Event("compare", watch.seconds, done, total))

        return diff(
            *pair.scenes,
            pair.viewpoints,
            numerics=pair.numerics,
            execution=pair.execution,
            progress=tell,
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
    from gsedit.files.cameras import cameras_file
    from gsedit.views.dataset import evenly_spaced

    beside = other if not cameras_file(scene) and cameras_file(other) else scene
    placed = place(beside, gaussians, options, count, execution)
    chosen = evenly_spaced(len(placed.viewpoints), count)
    return tuple(placed.viewpoints[index] for index in chosen)


def draw(result: SceneDifference, pair: Pair, out: Path, force: bool) -> None:
    """Write the picture: the worst view, and evenly spaced ones of the others."""
    from gsedit.points.differences import picture
    from gsedit.reports.difference_picture import Pair as Pictures
    from gsedit.reports.difference_picture import difference_picture
    from gsedit.views.dataset import evenly_spaced

    worst = result.views.index(result.worst)
    others = [index for index in range(len(result.views)) if index != worst]
    chosen = [worst, *(others[i] for i in evenly_spaced(len(others), SHOWN - 1))]
    pairs = []
    for index in chosen:
        view, camera = result.views[index], pair.viewpoints[index].camera
        title = (
            f"{Path(view.name).stem[:24]}: {view.psnr:.1f} dB{' (worst)' if index == worst else ''}"
        )
        before, after = (
            picture(scene, camera, pair.execution, own)
            for scene, own in zip(pair.scenes, pair.numerics)
        )
        pairs.append(Pictures(title, before, after))
    names = pair.paths[0].name, pair.paths[1].name
    difference_picture(pairs, names, out, overwrite=force)


def as_record(result: SceneDifference) -> dict[str, object]:
    """The comparison for JSON."""
    from dataclasses import asdict

    from gsedit.points.differences import QUANTILES

    return {**asdict(result), "quantiles": QUANTILES, "worst_view": result.worst.name}


def as_text(result: SceneDifference, paths: tuple[Path, Path]) -> str:
    """The comparison as aligned tables."""
    from gsedit.points.differences import QUANTILES

    counts, degrees = result.counts, result.sh_degrees
    change = f"{100 * (counts[1] - counts[0]) / counts[0]:+.1f} %"
    quantiles = "".join(f"{q:<10.0%}" for q in QUANTILES)
    lines = [
        row("", "before", "after", "change"),
        row("file", shortened(paths[0]), shortened(paths[1])),
        row("Gaussians", f"{counts[0]:,}", f"{counts[1]:,}", change),
        row("SH degree", f"{degrees[0]}", f"{degrees[1]}", f"{degrees[1] - degrees[0]:+}"),
        row("", quantiles, quantiles, "of 50%"),
    ]
    for each in result.attributes:
        if each.name == "sh_energy" and degrees == (0, 0):
            continue
        before, after = (
            "".join(f"{value:<10.3g}" for value in values) for values in (each.before, each.after)
        )
        lines.append(row(each.name, before, after, f"{each.after[1] - each.before[1]:+.2g}"))
    lines += ["", matches_text(result.matches), "", views_text(result)]
    lines += [f"-> {hint}" for hint in result.hints]
    if result.hints and not any("--mirror" in hint for hint in result.hints):
        command = ["gsedit", "align", f"{paths[1]}", "--to", f"{paths[0]}", "-o", "ALIGNED.ply"]
        lines.append(f"-> to compare them in one frame: {shlex.join(command)}")
    return "\n".join(lines)


def row(name: str, before: str, after: str, change: str = "") -> str:
    return f"{name:<11}{before:<31}{after:<31}{change}".rstrip()


def shortened(path: Path) -> str:
    """A file's name in 30 characters, with its folder if there is room."""
    text = str(path)
    return text if len(text) <= 30 else path.name[:30]


def matches_text(matches: Matches) -> str:
    """Which Gaussians both scenes share, in words."""
    sample = " (of a sample)" if matches.sampled else ""
    if matches.same_rows:
        text = "the same Gaussians, row by row"
    else:
        text = (
            f"{matches.of_before:.1%} of the first scene's Gaussians are in the second, "
            f"{matches.of_after:.1%} of the second's in the first{sample}"
        )
    if matches.moved is None or max(matches.of_before, matches.of_after) < FEW:
        return text
    return (
        f"{text}\nthese differ (RMS) in place by {matches.moved:.3g}, in the logarithm of size by "
        f"{matches.resized:.3g}, in opacity by {matches.opacity:.3g}, in colour by "
        f"{matches.color:.3g}"
    )


def views_text(result: SceneDifference) -> str:
    """The views, a line each, and all of them."""
    lines = [f"{'view':<24}{'PSNR, dB':>10}{'SSIM':>9}{'largest difference':>20}"]
    for view in result.views:
        mark = "  worst" if view is result.worst and len(result.views) > 1 else ""
        numbers = f"{view.psnr:>10.2f}{view.ssim:>9.4f}{view.largest:>20.3f}"
        lines.append(f"{view.name[:23]:<24}{numbers}{mark}")
    return "\n".join([*lines, f"{'all':<24}{result.psnr:>10.2f}{result.ssim:>9.4f}"])
