"""`gsedit info`: what a scene file holds."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_result
from .file_options import FileOptions
from .options import Common, Force, Scene, check_file

if TYPE_CHECKING:
    from gsedit.files.streams import SceneSource
    from gsedit.reports.scene_summary import SceneSummary

Plot = Annotated[
    Path | None,
    typer.Option(
        "--plot", metavar="PNG", show_default=False, help="Picture of histograms to write."
    ),
]


def info(
    scene: Scene,
    plot: Plot = None,
    force: Force = False,
    *,
    files: FileOptions,
    common: Common,
) -> None:
    """Show what a scene file holds: Gaussians, SH degree, bounds, opacities, sizes, colours,
    invalid rows, and everything beside them.

    gsedit info scene.ply --plot histograms.png
    """
    from gsedit.files.formats import open_scene
    from gsedit.reports.scene_summary import summarise

    if plot is not None:
        check_file(plot, force)
    source = open_scene(scene, files.read())
    summary, sample = summarise(source)
    if plot is not None:
        from gsedit.reports.histograms import plot_histograms

        plot_histograms(sample, scene.name, plot, overwrite=force)
    size = bytes_of(source.path)
    record = {"file": scene, "bytes": size, **of_file(source), **asdict(summary), "plot": plot}
    print_result(record, as_text(source, size, summary, plot), as_json=common.json)


def bytes_of(path: Path) -> int:
    """Of the file, or of the folder of a SOG scene, whose meta.json this is."""
    files = path.parent.iterdir() if path.name == "meta.json" else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def of_file(source: SceneSource) -> dict[str, Any]:
    """What holds for the whole file."""
    header = source.header
    return {
        "format": source.format,
        "extra": {name: str(kind) for name, kind in header.extra.items()},
        "elements": {name: len(rows) for name, rows in header.elements.items()},
        "comments": header.comments,
        "antialiased": header.antialiased,
        "notes": source.notes,
    }


def as_text(source: SceneSource, size: int, summary: SceneSummary, plot: Path | None) -> str:
    """The summary as an aligned table; `size` is in bytes."""
    header, rows = source.header, summary.gaussians + summary.invalid
    facts = [
        ("file", f"{source.path} ({size / 1e6:.2f} MB, {size / rows:.1f} bytes a Gaussian)"),
        ("format", source.format + ", trained with antialiasing" * header.antialiased),
        ("Gaussians", f"{summary.gaussians:,}"),
        ("SH degree", str(header.degree)),
    ]
    invalid = f"{summary.invalid:,} rows more, in no number below: {summary.first_invalid}"
    facts += [("invalid", invalid)] * bool(summary.invalid)
    columns = ", ".join(f"{name} ({kind})" for name, kind in header.extra.items())
    facts += [("columns", f"{columns} beside those of a splat")] * bool(columns)
    elements = ", ".join(f"{name} ({len(rows):,} rows)" for name, rows in header.elements.items())
    facts += [("elements", elements)] * bool(elements)
    facts += [("comment", comment) for comment in header.comments]
    facts += [("note", note) for note in source.notes]
    facts += [("histograms", str(plot))] * (plot is not None)
    return "\n".join((*(f"{name:<12}{text}" for name, text in facts), *table_of(summary)))


def table_of(summary: SceneSummary) -> list[str]:
    """The distributions as lines; the header names the quantiles."""
    from gsedit.reports.scene_summary import COLUMNS

    ends = {0.0: "min", 1.0: "max"}
    head = "".join(f"{ends.get(q, f'{q:.0%}'):>12}" for q in summary.quantiles)
    every = f"   (quantiles: of 1 row in {summary.quantiles_of_every})"
    lines = [f"{'':<12}{head}" + every * (summary.quantiles_of_every > 1)]
    return lines + [
        f"{name:<12}" + "".join(f"{value:>12.4g}" for value in getattr(summary, name))
        for name in COLUMNS
    ]
