"""Summaries of scenes in a few numbers: read once, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gsedit.errors import InputError
from gsedit.formats.streams import SceneSource
from gsedit.formats.validity import Guard
from gsedit.scene.shapes import Float
from gsedit.scene.table import SplatTable
from rasterizer.numerics import sh_to_color

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)
MOST_VALUES = 1 << 22
"""Rows whose values are kept for the quantiles: of a larger scene, every second, third, ... row.
Four million give the rank of a quantile to 0.02 %; least and greatest values are of all rows."""
COLUMNS = ("x", "y", "z", "opacity", "scale", "elongation", "red", "green", "blue")

Quantiles = tuple[float, ...]
"""Values of a distribution, at some shares of its order."""


@dataclass(frozen=True)
class SceneSummary:
    """Counts of a scene, and the distributions of its values. Lengths are in world units."""

    gaussians: int
    """Valid rows: the numbers below are theirs."""
    sh_degree: int
    quantiles: Quantiles
    """QUANTILES, in [0, 1]."""
    quantiles_of_every: int
    """1: of every row; 3: the quantiles are those of every third row."""
    x: Quantiles
    y: Quantiles
    z: Quantiles
    """Coordinates of the centers along the third axis."""
    opacity: Quantiles
    """Opacities in [0, 1]."""
    scale: Quantiles
    """Standard deviations along all three axes."""
    elongation: Quantiles
    """Largest standard deviation over the second one, for each Gaussian: 1 is a ball or a disk."""
    red: Quantiles
    green: Quantiles
    blue: Quantiles
    """Colors without view dependence, blue channel; 0 to 1 is what a screen shows."""
    invalid: int = 0
    """Rows with NaN or Inf, a quaternion of length 0, or a scale beyond any scene."""
    first_invalid: str = ""
    """First invalid row and its problem, in words."""


@dataclass
class Sample:
    """The values of a scene as blocks pass: of every n-th row, and the ends of all."""

    every: int
    rows: int = 0
    parts: dict[str, list[np.ndarray]] = field(default_factory=dict)
    low: dict[str, float] = field(default_factory=dict)
    high: dict[str, float] = field(default_factory=dict)

    def add(self, table: SplatTable) -> None:
        chosen = slice(-self.rows % self.every, None, self.every)
        self.rows += len(table)
        for name, values in stored_values(table):
            self.parts.setdefault(name, []).append(values[chosen].ravel())
            self.low[name] = min(self.low.get(name, np.inf), float(values.min()))
            self.high[name] = max(self.high.get(name, -np.inf), float(values.max()))

    def values(self, name: str) -> np.ndarray:
        """The kept values of one of COLUMNS."""
        return in_units(name, np.concatenate(self.parts[name]))

    def quantiles(self, name: str) -> Quantiles:
        """The values at QUANTILES, nearest rank."""
        inner = quantiles_of(np.concatenate(self.parts[name]), QUANTILES[1:-1])
        stored = np.array([self.low[name], *inner, self.high[name]])
        return tuple((in_units(name, stored) + 0.0).tolist())  # -0 becomes 0


def stored_values(table: SplatTable) -> Iterator[tuple[str, np.ndarray]]:
    """The values of COLUMNS before the functions of `in_units`, all of which rise."""
    yield from zip("xyz", table.means.T)
    yield "opacity", table.logit_opacities
    yield "scale", table.log_scales
    ordered = np.sort(table.log_scales, axis=1)
    yield "elongation", ordered[:, 2] - ordered[:, 1]
    yield from zip(("red", "green", "blue"), table.sh[:, 0].T)


def in_units(name: str, values: np.ndarray) -> np.ndarray:
    """Stored values as a person reads them: opacities in [0, 1], lengths, colors."""
    with np.errstate(over="ignore"):
        if name == "opacity":
            return 1 / (1 + np.exp(-values))
        if name in ("scale", "elongation"):
            return np.exp(values)
    return sh_to_color(values) if name in ("red", "green", "blue") else values


def summarise(source: SceneSource) -> tuple[SceneSummary, Sample]:
    """The summary of a scene file and the values it is made of. Invalid rows are left out of
    everything, and counted. Raises InputError where no row is valid."""
    guard = Guard(drop=True)
    sample = Sample(max(1, -(-source.count // MOST_VALUES)))
    for block in guard(source.blocks()):
        if len(block):
            sample.add(block)
    guard.check(source.path)
    if not sample.rows:
        raise InputError(f"{source.path} holds no Gaussians: export it again")
    summary = SceneSummary(
        sample.rows,
        source.header.degree,
        QUANTILES,
        sample.every,
        **{name: sample.quantiles(name) for name in COLUMNS},
        invalid=guard.invalid,
        first_invalid=guard.first,
    )
    return summary, sample


def quantiles_of(values: Float[np.ndarray, " n"], shares: Quantiles) -> Quantiles:
    """The values at some shares of the order, nearest rank; 0 of none. `values` is reordered."""
    if not len(values):
        return (0.0,) * len(shares)
    ranks = [round(share * (len(values) - 1)) for share in shares]
    values.partition(sorted(set(ranks)))
    return tuple(float(values[rank]) for rank in ranks)


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
