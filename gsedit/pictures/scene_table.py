"""Summary of a scene file as text."""

from __future__ import annotations

from gsedit.formats.streams import SceneSource
from gsedit.toolkit.scene_summary import COLUMNS, SceneSummary


def summary_table(source: SceneSource, size: int, summary: SceneSummary) -> str:
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
