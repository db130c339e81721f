"""`gsedit info`: the contents and the defects of a scene file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gsedit.errors import UsageError

from ..core.command import flag, option
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.common import Common, Force, Scene
from ..options.files import FileOptions

if TYPE_CHECKING:
    from gsedit.formats.streams import SceneSource

Plot = Annotated[Path | None, flag("--plot", "Picture of histograms to write.", "PNG")]


@dataclass(frozen=True)
class CheckOptions:
    """How a scene file is checked for defects."""

    check: bool = option(
        False, "List every defect instead, with its rows and the command that mends it."
    )
    quick: bool = option(
        False, "--check: only defects of single rows, for files larger than memory."
    )
    strict: bool = option(False, "--check: exit code 1 for any defect, not only for invalid rows.")


def info(
    scene: Scene,
    plot: Plot = None,
    force: Force = False,
    *,
    checks: CheckOptions,
    files: FileOptions,
    common: Common,
) -> None:
    """Show what a scene file holds, or with --check its defects.

    gsedit info scene.ply --plot histograms.png

    gsedit info scene.ply --check

    --check also reads files that other commands refuse. Its exit code is 1 where rows are invalid
    (NaN, Inf, a rotation of length 0) and 0 otherwise: floaters, needles and the like are no
    error. docs/howto/clean.md explains every criterion and its threshold.
    """
    from gsedit.formats.registry import open_scene

    if not checks.check and (checks.quick or checks.strict):
        raise UsageError("--quick and --strict belong to --check: add it")
    if checks.check and plot is not None:
        raise UsageError("--check draws no histograms: leave out --plot")
    common.apply()
    check_file(plot, force)
    source = open_scene(scene, files.read())
    if checks.check:
        check_scene(scene, source, checks, as_json=common.json)
    else:
        show_summary(scene, source, plot, force, as_json=common.json)


def show_summary(
    scene: Path, source: SceneSource, plot: Path | None, force: bool, *, as_json: bool
) -> None:
    """Print the summary of a scene, and draw its histograms."""
    from gsedit.pictures.scene_table import summary_table
    from gsedit.toolkit.scene_summary import summarise

    summary, sample = summarise(source)
    if plot is not None:
        from gsedit.pictures.scene_table import plot_histograms

        plot_histograms(sample, scene.name, plot, overwrite=force)
    size = bytes_of(source.path)
    record = {"file": scene, "bytes": size, **of_file(source), **asdict(summary), "plot": plot}
    print_result(record, summary_table(source, size, summary, plot), as_json=as_json)


def check_scene(scene: Path, source: SceneSource, checks: CheckOptions, *, as_json: bool) -> None:
    """Print the defects of a scene. Exits with 1 where rows are invalid, or for any if strict."""
    from gsedit.toolkit.check import check, defect_record, defect_table

    for note in source.notes:
        print_message(f"{scene}: {note}")
    report = check(source, quick=checks.quick)
    record = {"file": scene, "format": source.format, **defect_record(report)}
    text = defect_table(scene, source.format, report, checks.quick)
    print_result(record, text, as_json=as_json)
    if report.refused or (checks.strict and report.found):
        raise typer.Exit(1)


def bytes_of(path: Path) -> int:
    """Return the size of a file, or of the folder of a SOG scene that it is the index of."""
    from gsedit.formats.table import INDEX

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
