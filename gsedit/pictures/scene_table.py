"""Summary of a scene file, as text and as a picture of histograms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gsedit.formats.streams import SceneSource
from gsedit.run.atomic import atomic_path
from gsedit.run.environment import load_extra
from gsedit.toolkit.scene_summary import COLUMNS, Sample, SceneSummary


def summary_table(source: SceneSource, size: int, summary: SceneSummary, plot: Path | None) -> str:
    """Return the summary as an aligned table; `size` is in bytes."""
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
    """Return the distributions as lines; the header names the quantiles."""
    ends = {0.0: "min", 1.0: "max"}
    head = "".join(f"{ends.get(q, f'{q:.0%}'):>12}" for q in summary.quantiles)
    every = f"   (quantiles: of 1 row in {summary.quantiles_of_every})"
    lines = [f"{'':<12}{head}" + every * (summary.quantiles_of_every > 1)]
    return lines + [
        f"{name:<12}" + "".join(f"{value:>12.4g}" for value in getattr(summary, name))
        for name in COLUMNS
    ]


BINS = 100
LARGEST_VALUE = 1e30
"""Largest value that is drawn: the elongation of a needle may be infinite in float32."""
INNER = (0.005, 0.995)
"""The share of the values that an axis shows: a few strays would make the rest one bar."""


def plot_histograms(sample: Sample, title: str, path: Path, *, overwrite: bool = False) -> None:
    """Write six histograms as PNG, 1200 x 700 pixels. Raises GseditError without matplotlib."""
    drawing = load_extra("matplotlib.figure", "a picture of histograms")
    figure = drawing.Figure(figsize=(12, 7), layout="constrained")
    figure.suptitle(title, parse_math=False)  # a dollar sign in a file's name is no formula
    panels = (
        ("position (world units)", {"x": "tab:red", "y": "tab:green", "z": "tab:blue"}, False),
        ("opacity", {"opacity": "black"}, False),
        ("size: standard deviations (world units)", {"scale": "black"}, True),
        ("elongation: largest size over second", {"elongation": "black"}, True),
        ("color", {"red": "tab:red", "green": "tab:green", "blue": "tab:blue"}, False),
    )
    grid = figure.subplots(2, 3).ravel()
    for axes, (label, lines, logarithmic) in zip(grid, panels):
        _panel(axes, sample, label, lines, logarithmic)
    _map(grid[5], sample)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, dpi=100, format="png")


def _panel(axes: Any, sample: Sample, label: str, lines: dict[str, str], logarithmic: bool) -> None:
    values = {name: np.minimum(sample.values(name), LARGEST_VALUE) for name in lines}
    ends = np.array([np.quantile(v, INNER) for v in values.values()])
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    if label == "opacity":
        low, high = 0.0, 1.0
    if high <= low:
        low, high = low * 0.9 - 0.1, high * 1.1 + 0.1
    edges = np.linspace(low, high, BINS + 1)
    if logarithmic:
        edges = np.geomspace(max(low, 1e-12), max(high, 2e-12), BINS + 1)
    for name, color in lines.items():
        counts = np.histogram(values[name], edges)[0] * sample.every
        axes.stairs(counts, edges, color=color, label=name, fill=len(lines) == 1)
    axes.set_xscale("log" if logarithmic else "linear")
    axes.set(xlabel=label, ylabel="Gaussians", ylim=(0, None))
    if len(lines) > 1:
        axes.legend(frameon=False)


def _map(axes: Any, sample: Sample) -> None:
    """Draw the Gaussians as seen along y: the ground plan of a scene that stands upright."""
    x, z = sample.values("x"), sample.values("z")
    limits = [np.quantile(v, INNER) for v in (x, z)]
    limits = [(low, max(high, low + 1e-6)) for low, high in limits]
    counts = np.histogram2d(x, z, BINS, limits)[0].T
    axes.imshow(
        np.log1p(counts), origin="lower", extent=(*limits[0], *limits[1]), cmap="magma",
        aspect="auto",
    )  # fmt: skip
    axes.set(xlabel="x", ylabel="z", title="number along y (logarithmic)")
