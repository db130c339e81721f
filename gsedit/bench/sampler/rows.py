"""Measurements of the sampler, as records, JSON lines and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from itertools import groupby
from typing import Literal

import torch

from gsedit.bench.measure import commit, machine
from gsedit.bench.renderer.rows import markdown

Study = Literal["solver", "stiff", "consensus", "cost"]


@dataclass(frozen=True)
class SamplerRow:
    """One measurement; None where it does not apply."""

    study: Study
    problem: str
    variant: str
    """The solver, or the way of agreeing, or what was timed."""
    steps: int
    evaluations: int
    seconds: float
    yardstick: float | None = None
    """Seconds of a pass of the yardstick (see measure.py), beside it."""
    error: float | None = None
    disagreement: float | None = None
    """RMS difference of corresponding cells from their mean, in the units of the result."""
    contrast: float | None = None
    """Standard deviation inside a view, over that of views sampled alone."""
    strength: float | None = None
    """RMS difference from the unedited views."""
    t_end: float | None = None
    overhead: float | None = None
    """Our loop's seconds over those of the bare network calls, less 1."""
    note: str = ""
    threads: int = 0
    commit: str = ""
    machine: str = ""
    date: str = ""


COLUMNS = {
    "solver": ("error", "seconds"),
    "stiff": ("error", "note"),
    "consensus": ("disagreement", "contrast", "strength", "seconds"),
    "cost": ("seconds", "overhead", "error", "note"),
}
TITLES = {
    "solver": "Error against the exact path, standard deviations of the data",
    "stiff": "Extremes, float32: distance from the nearest component, standard deviations",
    "consensus": "Agreement, contrast kept and edit strength",
    "cost": "Cost",
}


def table(rows: Iterable[SamplerRow]) -> str:
    """Markdown: a heading and a table a study. Solver errors stand beside each other by steps."""
    parts = []
    for study, found in groupby(rows, key=lambda row: row.study):
        group = list(found)
        parts.append(f"## {TITLES[study]}")
        match study:
            case "solver":
                parts.append(_across(group, "evaluations", lambda row: row.variant))
            case "stiff":
                parts.append(_across(group, "steps", lambda row: row.variant))
            case _:
                parts.append(_plain(group, COLUMNS[study]))
        if study == "solver":
            parts.append("Columns: evaluations of the network, of all branches at once.")
    if not parts:
        return "Nothing was measured.\n"
    first = f"{machine()}, {torch.get_num_threads()} threads, commit {commit()}"
    return "\n\n".join((first, *parts)) + "\n"


def _across(rows: list[SamplerRow], column: str, variant: Callable[[SamplerRow], str]) -> str:
    """A line a problem and solver, its errors in columns."""
    columns = sorted({getattr(row, column) for row in rows})
    cells: dict[tuple[str, str], dict[int, str]] = {}
    for row in rows:
        cells.setdefault((row.problem, variant(row)), {})[getattr(row, column)] = _error(row)
    lines = [
        [f"{problem}: {solver}", *(found.get(c, "") for c in columns)]
        for (problem, solver), found in cells.items()
    ]
    return markdown(("", *map(str, columns)), lines)


def _error(row: SamplerRow) -> str:
    return row.note if row.error is None else f"{row.error:.1e}" + "!" * bool(row.note)


def _plain(rows: list[SamplerRow], columns: tuple[str, ...]) -> str:
    head = ("", "steps", *columns)
    return markdown(head, [[_name(row), str(row.steps), *_values(row, columns)] for row in rows])


def _name(row: SamplerRow) -> str:
    at = "" if row.t_end is None else f" {row.t_end:g}"
    return f"{row.problem}{at}: {row.variant}"


def _values(row: SamplerRow, columns: tuple[str, ...]) -> list[str]:
    def told(value: object) -> str:
        return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)

    known = {field.name for field in fields(SamplerRow)}
    return [told(getattr(row, column)) for column in columns if column in known]
