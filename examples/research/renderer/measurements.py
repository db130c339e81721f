"""Measurements of the renderer: as records and a Markdown table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

from gsedit.bench.results import markdown_table

OURS = "gsedit"


@dataclass(frozen=True)
class RenderMeasurement:
    """One scene drawn in one way: how long it took and how wrong it is. None: not measured.

    The fields are those of a line of bench.jsonl.
    """

    scene: str
    implementation: str
    """gsedit or a baseline."""
    knob: str
    """The setting that differs from the defaults; "default" where none does."""
    value: str
    gaussians: int
    width: int
    height: int
    pairs: int
    """Number of (tile, Gaussian) pairs."""
    evaluated: int
    """Pixel-pairs in those tiles."""
    dtype: str
    threads: int
    runs: int
    """The seconds below are medians of so many; forward + backward may have fewer than forward."""
    forward_wall: float | None
    """Seconds of wall clock, projection and sorting included."""
    forward_cpu: float | None
    """Seconds of all threads together."""
    both_wall: float | None
    """Forward and backward, to the gradients of the scene."""
    both_cpu: float | None
    error_mean: float | None
    """Mean error of colors in [0, 1] against the float64 reference, over pixels and channels."""
    error_tail: float | None
    """99.9 % of the errors are at most this."""
    error_max: float | None
    gradient_error: float | None
    """Relative error of the scene's worst field: |difference| / |reference|."""
    gradient_cosine: float | None
    """Cosine between the gradient of the scene's worst field and the reference's."""
    peak_bytes: int | None
    """Memory of forward and backward, above the inputs."""
    note: str
    """Reason of a failure; empty where there was none."""
    commit: str
    machine: str
    date: str
    """Date and time, ISO 8601, UTC."""

    @property
    def label(self) -> str:
        """Name of the row among those of its scene."""
        if self.implementation != OURS:
            return self.implementation
        return "default" if self.knob == "default" else f"{self.knob} {self.value}"


HEAD = (
    "", "fwd ms", "CPU ms", "both ms", "CPU ms", "mean error", "99.9 %", "max", "gradients",
    "1 - cos", "peak MB", "n",
)  # fmt: skip


def table(rows: Iterable[RenderMeasurement]) -> str:
    """Markdown: a heading and a table a scene, and what the columns mean."""
    parts = [_LEGEND]
    for scene, members in groupby(rows, key=lambda row: row.scene):
        group = list(members)
        parts += [_heading(scene, group[0]), markdown_table(HEAD, [_cells(row) for row in group])]
        parts += [f"- {row.label}: {row.note}" for row in group if row.note]
    return "\n\n".join(parts) + "\n"


_LEGEND = (
    "Times are medians of n runs, projection and sorting included; both: forward and backward, to "
    "the gradients of every input, the pose too; CPU: all threads together. Errors are of colors "
    "in [0, 1] against the float64 reference, which has no early stop and no tiles; gradients: "
    "relative L2 error, and 1 - cosine, of the worst input. Peak memory of both, above the inputs."
)


def _heading(scene: str, row: RenderMeasurement) -> str:
    pairs = " / ".join(_millions(n) for n in (row.pairs, row.evaluated))
    return (
        f"## {scene}\n\n{row.gaussians:,} Gaussians, {row.width}x{row.height}, {row.dtype}; "
        f"{pairs} million pairs tiled / evaluated; {row.threads} "
        f"thread{'s' * (row.threads > 1)} of {row.machine}; commit {row.commit}, {row.date[:10]}"
    )


def _millions(count: int) -> str:
    return f"{count / 1e6:.3g}"


def _cells(row: RenderMeasurement) -> list[str]:
    def milliseconds(seconds: float | None) -> str:
        return "" if seconds is None else f"{1e3 * seconds:.3g}"

    def error(value: float | None) -> str:
        return "" if value is None else f"{value:.1e}"

    gap = None if row.gradient_cosine is None else 1 - row.gradient_cosine
    return [
        f"**{row.label}**" if row.label == "default" else row.label,
        milliseconds(row.forward_wall), milliseconds(row.forward_cpu),
        milliseconds(row.both_wall), milliseconds(row.both_cpu),
        error(row.error_mean), error(row.error_tail), error(row.error_max),
        error(row.gradient_error), error(gap),
        "" if row.peak_bytes is None else f"{row.peak_bytes / 1e6:.0f}",
        str(row.runs) if row.runs else "",
    ]  # fmt: skip
