"""Measurements of the sampler, as records and tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.results import commit, machine, markdown_table

Study = Literal["solver", "consensus"]


@dataclass(frozen=True)
class SamplerMeasurement:
    """One measurement; None where a field does not apply. The fields are those of bench.jsonl."""

    study: Study
    problem: str
    variant: str
    """The solver, or the variant of consensus."""
    steps: int
    evaluations: int
    seconds: float
    error: float | None = None
    disagreement: float | None = None
    """RMS difference of corresponding cells from their mean, in the units of the result."""
    deviation: float | None = None
    """The signed share of the disagreement without consensus that is left: 1 all, 0 none, negative
    beyond agreement."""
    contrast: float | None = None
    """Standard deviation inside a view, over that of views sampled alone."""
    strength: float | None = None
    """RMS difference from the unedited views."""
    t_end: float | None = None
    """Number of steps with consensus."""
    note: str = ""
    threads: int = 0
    commit: str = ""
    machine: str = ""
    date: str = ""


COLUMNS = ("disagreement", "deviation", "contrast", "strength", "seconds")
"""Columns of the table of consensus."""
TITLES = {
    "solver": "Error against the exact path, standard deviations of the data",
    "consensus": "Agreement, contrast kept and edit strength",
}


def table(rows: Iterable[SamplerMeasurement]) -> str:
    """Markdown: a heading and a table a study; errors of solvers in columns by cost."""
    parts = []
    for study, members in groupby(rows, key=lambda row: row.study):
        group = list(members)
        parts.append(f"## {TITLES[study]}")
        match study:
            case "solver":
                parts.append(_across(group, "evaluations"))
                parts.append("Columns: evaluations of the network, each of all branches at once.")
            case _:
                parts.append(_plain(group))
    if not parts:
        return "Nothing was measured.\n"
    threads = torch.get_num_threads()
    first = f"{machine()}, {threads} thread{'s' * (threads > 1)}, commit {commit()}"
    return "\n\n".join((first, *parts)) + "\n"


def _across(rows: list[SamplerMeasurement], column: Literal["evaluations", "steps"]) -> str:
    """A line a problem and solver, its errors in columns."""
    columns = sorted({getattr(row, column) for row in rows})
    cells: dict[tuple[str, str], dict[int, str]] = {}
    for row in rows:
        cells.setdefault((row.problem, row.variant), {})[getattr(row, column)] = _error(row)
    lines = [
        [f"{problem}: {solver}", *(by_cost.get(c, "") for c in columns)]
        for (problem, solver), by_cost in cells.items()
    ]
    return markdown_table(("", *map(str, columns)), lines)


def _error(row: SamplerMeasurement) -> str:
    return row.note if row.error is None else f"{row.error:.1e}" + "!" * bool(row.note)


def _plain(rows: list[SamplerMeasurement]) -> str:
    lines = [[_name(row), str(row.steps), *_values(row)] for row in rows]
    return markdown_table(("", "steps", *COLUMNS), lines)


def _name(row: SamplerMeasurement) -> str:
    at = "" if row.t_end is None else f" {row.t_end:g}"
    return f"{row.problem}{at}: {row.variant}"


def _values(row: SamplerMeasurement) -> list[str]:
    def cell(value: object) -> str:
        return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)

    return [cell(getattr(row, column)) for column in COLUMNS]


def rms(x: Float[Tensor, ...]) -> float:
    """Root mean square of all elements, computed in float64."""
    return float(x.double().square().mean().sqrt())
