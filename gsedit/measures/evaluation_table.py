"""Results of `gsedit metrics` as a plain text table of 80 columns and as a record for JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

from gsedit.measures.against import Reference
from gsedit.measures.agreement import PointComparison, WarpComparison
from gsedit.measures.evaluation_input import MEASURED_ROLES, Evaluation, Mean
from gsedit.measures.metrics import COST, METRICS, label_of
from gsedit.run.environment import environment

COLUMNS = 80
LABEL, NUMBER = 40, 15
"""Columns of a metric's name, and of a number."""


def evaluation_record(
    evaluation: Evaluation, request: Mapping[str, Any], against: Reference
) -> dict[str, Any]:
    """The record of --json and -o: what was asked, measured and not measured, and by what."""
    return {
        **request,
        "views": {role: evaluation.number(role) for role in MEASURED_ROLES},
        "measured": {
            **evaluation.record(),
            **against.cost,
        },
        "not_measured": {**evaluation.not_measured, **missing_cost(against)},
        "by_view": evaluation.views,
        **environment(),
    }


def missing_cost(against: Reference) -> dict[str, str]:
    """Why the cost of the edit is not known."""
    return {name: against.why_no_cost for name in COST if name not in against.cost}


def evaluation_table(evaluation: Evaluation, against: Reference) -> str:
    """For a person: values, warp errors, cost, and what is not measured."""
    cost, targets = against.cost, against.targets
    kinds = {"edited": against.fitted, "held_out": "held out"}
    heads = [f"{kinds[role]} ({evaluation.number(role)})" for role in MEASURED_ROLES]
    lines = [_line("metric", *heads, "better")]
    for name, metric in METRICS.items():
        if by_role := evaluation.measured.get(name):
            label = label_of(name, targets)
            if "all" in by_role:
                cells = [_cell(by_role["all"], metric.decimals), f"{by_role['all'].views} views"]
            else:
                cells = [_cell(by_role.get(role), metric.decimals) for role in MEASURED_ROLES]
            lines.append(_line(label, *cells, "" if metric.better == "neither" else metric.better))
    if evaluation.warp:
        lines += ["", _line("warp error (RMSE)", "unedited", "edited", "excess")]
        lines += [_pair_line(row, targets) for row in evaluation.warp]
    if evaluation.points:
        lines += ["", _line("difference at SIFT matches (RMSE)", "unedited", "edited", "excess")]
        lines += [_pair_line(row, targets) for row in evaluation.points]
    if cost:
        lines += ["", *(f"{COST[name]:<{LABEL}}{cost[name]:>{NUMBER}.0f}" for name in cost)]
    lines += _notes(evaluation, targets)
    missing = {**evaluation.not_measured, **missing_cost(against)}
    return "\n".join([*lines, *_missing(missing, targets)])


def _line(label: str, *cells: str) -> str:
    widths = (NUMBER, NUMBER, COLUMNS - LABEL - 2 * NUMBER)
    return (
        f"{label:<{LABEL}}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths))
    ).rstrip()


def _cell(mean: Mean | None, decimals: int) -> str:
    return "-" if mean is None else f"{mean.value:.{decimals}f}"


def _pair_line(row: WarpComparison | PointComparison, targets: str) -> str:
    kind = targets if row.pictures == "targets" else "renders, held out"
    if isinstance(row, WarpComparison):
        label = f"{kind}, {row.range} range ({row.pairs} pairs)"
    else:
        label = f"{kind} ({row.points} points)"
    return _line(label, *(f"{value:.4f}" for value in (row.unedited, row.edited, row.excess)))


def _notes(evaluation: Evaluation, targets: str) -> list[str]:
    """Notes on means over fewer views than the head of their column says."""
    fewer: dict[str, list[str]] = {}
    for name, by_role in evaluation.measured.items():
        for role, mean in by_role.items():
            if role != "all" and mean.views < (of := evaluation.number(role)):
                note = f"over {mean.views} of {of} {role.replace('_', '-')} views"
                fewer.setdefault(note, []).append(label_of(name, targets))
    return _folded({f"{note}:": "; ".join(labels) for note, labels in fewer.items()})


def _missing(reasons: Mapping[str, str], targets: str) -> list[str]:
    """The metrics without a value, together where the reason is the same."""
    together: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        together.setdefault(reason, []).append(label_of(name, targets))
    if not together:
        return []
    return ["", "not measured:", *_folded({"; ".join(v) + ":": k for k, v in together.items()})[1:]]


def _folded(notes: Mapping[str, str]) -> list[str]:
    """One paragraph a note, within the columns; an empty line before them."""
    lines = [""] if notes else []
    for head, text in notes.items():
        lines += textwrap.wrap(f"{head} {text}", COLUMNS, subsequent_indent="  ")
    return lines
