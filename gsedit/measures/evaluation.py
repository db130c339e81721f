"""Every metric of a scene, at a fixed list of views, beside pictures and the unedited scene.

A metric that cannot be measured has no value, and a reason with the next move in its place. Both
`gsedit metrics` and `gsedit edit` measure by `evaluate`.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import sqrt
from typing import Any

import torch

from gsedit.measures.against import Reference
from gsedit.measures.agreement import (
    COMPARED_VIEWS,
    MATCHED_PIXELS,
    PairComparison,
    Pairs,
    PicturesOf,
    UneditedViews,
    compare_points,
    compare_renders,
    compare_targets,
    matchable,
    spread,
)
from gsedit.measures.formulas import (
    SquaredError,
    interval,
    mean_interval,
    perceptual,
    pooled_rmse,
    squared_error,
)
from gsedit.measures.metrics import (
    COST,
    LATER,
    MEASURED_ROLES,
    METRICS,
    NO_UNEDITED,
    PAIRS,
    SLOW,
    Evaluation,
    EvaluationInput,
    Group,
    Mean,
    MeasuredView,
    Metric,
    ViewMeasures,
    label_of,
    why_missing,
    why_missing_at,
)
from gsedit.run.environment import environment
from gsedit.views.dataset import evenly_spaced
from rasterizer.render import Rendering, render, render_picture

Progress = Callable[[int, int], None]
"""(views measured, views to measure)."""
Shown = Mapping[str, float | SquaredError]
"""By the name of a metric: the value at one view, or its part in what is pooled over views."""
NO_MATCHER = "points are matched by gsedit metrics, not during an edit: run it on the folder"


def evaluate(
    subject: EvaluationInput,
    progress: Progress = lambda done, total: None,
    only: Iterable[str] = (),
) -> Evaluation:
    """Measure a scene at the edited and held-out views of its list, a view at a time.

    `only`: names of METRICS; these alone are measured, and no reasons are given for others.
    """
    rows = [METRICS[name] for name in only] or [*METRICS.values()]
    rows = [row for row in rows if only or not (subject.quick and row.function in SLOW)]
    at = {row.name: _views_of(row, subject) for row in rows}
    chosen = sorted({i for views in at.values() for i in views})
    shown: dict[int, Shown] = {}
    for done, i in enumerate(chosen, 1):
        shown[i] = _measure(MeasuredView(subject, i), [row for row in rows if i in at[row.name]])
        progress(done, len(chosen))
    measured = {row.name: means for row in rows if (means := _means(row, subject, shown))}
    views = subject.views
    by_view = tuple(
        ViewMeasures(views.viewpoints[i].name, role, _values(shown.get(i, {})))
        for i, role in enumerate(views.roles)
        if role in MEASURED_ROLES
    )
    if only:
        return Evaluation(measured, (), {}, by_view)
    warp, points = _warp(subject), _points(subject)
    compared = tuple(each for each in points.values() if not isinstance(each, str))
    missing = {**_missing(subject, measured), **_missing_pairs(subject, warp, points)}
    return Evaluation(measured, warp, missing, by_view, compared)


def _groups(row: Metric) -> tuple[Group, ...]:
    """Roles whose views have means of their own."""
    return row.needs.roles if "all" in row.needs.roles else MEASURED_ROLES


def _having(group: Group, subject: EvaluationInput) -> Sequence[int]:
    return range(len(subject.views)) if group == "all" else subject.views.having(group)


def _views_of(row: Metric, subject: EvaluationInput) -> set[int]:
    """The views at which a metric is measured: a perceptual distance at few, evenly spaced."""
    chosen: set[int] = set()
    known = row.needs.views(subject)
    for group in _groups(row):
        views = [i for i in _having(group, subject) if i in known]
        most = subject.max_perceptual_views if row.function is perceptual else None
        chosen |= {views[k] for k in evenly_spaced(len(views), most or len(views))}
    return chosen


@torch.no_grad()
def _measure(view: MeasuredView, rows: Collection[Metric]) -> Shown:
    """Measure a scene at one view by each of the rows that has something to compare with."""
    expected = {needs: needs.at(view) for needs in {row.needs for row in rows}}
    found: dict[str, float | SquaredError] = {}
    for row in rows:
        picture, mask = expected[row.needs]
        if mask is not None and not mask.any():
            continue
        if row.needs.pooled:
            found[row.name] = squared_error(view.final, picture, mask)
        elif (value := row.function(view.final, picture, mask)) is not None:
            found[row.name] = value
    return found


def _values(shown: Shown) -> dict[str, float]:
    """The values of one view."""
    return {
        name: _of_rmse(METRICS[name], sqrt(each.total / each.values))
        if isinstance(each, SquaredError)
        else each
        for name, each in shown.items()
    }


def _of_rmse(row: Metric, error: float) -> float:
    """A metric of a pooled standard."""
    value = row.function(error)
    assert value is not None  # only what needs weights or size may be missing
    return value


def _means(row: Metric, subject: EvaluationInput, shown: Mapping[int, Shown]) -> dict[Group, Mean]:
    """Means of a metric over the views of each role that have a value."""
    found: dict[Group, Mean] = {}
    for group in _groups(row):
        views = (i for i in _having(group, subject) if row.name in shown.get(i, {}))
        if values := [shown[i][row.name] for i in views]:
            mean = _pooled(row, values) if row.needs.pooled else _mean(values)
            found[group] = replace(mean, against=row.needs.against(subject, group))
    return found


def _mean(values: Sequence[Any]) -> Mean:
    return Mean(sum(values) / len(values), len(values), mean_interval(values))


def _pooled(row: Metric, errors: Sequence[Any]) -> Mean:
    """The metric of the RMSE over all pixels, from an error each view."""
    views = range(len(errors))
    error = pooled_rmse(errors)
    within = interval(errors, [(i,) for i in views], lambda sums: (sums[0] / sums[1]) ** 0.5)
    assert error is not None  # no view without a pixel outside is here
    low, high = sorted(_of_rmse(row, end) for end in within or (error, error))
    return Mean(_of_rmse(row, error), len(errors), (low, high) if within else None)


def _warp(subject: EvaluationInput) -> tuple[PairComparison, ...]:
    """Warp errors of targets and of renders at held-out views; none without the unedited scene."""
    original = subject.unedited
    if original is None:
        return ()
    cameras = [viewpoint.camera for viewpoint in subject.views.viewpoints]

    @cache
    @torch.no_grad()
    def rendering(i: int) -> Rendering:
        if i in subject.renderings:
            return subject.renderings[i]
        return render(original, cameras[i], median_depth=True)

    views = UneditedViews(cameras, rendering, subject.quick)
    held_out = subject.views.having("held_out")
    edited = {i: subject.targets[i] for i in subject.views.having("edited") if i in subject.targets}
    return (
        *compare_targets(views, edited),
        *compare_renders(
            views, spread(held_out, COMPARED_VIEWS), held_out,
            lambda indices: {i: MeasuredView(subject, i).final for i in indices},
        ),
    )  # fmt: skip


@torch.no_grad()
def _points(subject: EvaluationInput) -> dict[PicturesOf, PairComparison | str]:
    """Differences at matched points of the targets, and of renders at held-out views; or the reason
    why there are too few points. None without a matcher, or views that look alike."""
    scene, views = subject.unedited, subject.views
    if scene is None or subject.matcher is None:
        return {}
    cameras = [viewpoint.camera for viewpoint in views.viewpoints]
    targets = [i for i in views.having("edited") if i in subject.targets]
    pairs: dict[PicturesOf, Pairs] = {
        "targets": matchable(targets, cameras),
        "renders": matchable(views.having("held_out"), cameras),
    }
    every = sorted({pair for each in pairs.values() for pair in each})
    chosen = {i: MeasuredView(subject, i) for i in sorted({i for pair in every for i in pair})}
    larger = {i: max(1.0, MATCHED_PIXELS / cameras[i].longest) for i in chosen}
    large = {i: cameras[i].scaled(factor) for i, factor in larger.items()}
    pictures = {i: render_picture(scene, large[i]) for i in chosen}
    matches = subject.matcher(pictures, large, every) if every else {}
    before = {i: view.unedited for i, view in chosen.items()}
    after = {"targets": subject.targets, "renders": {i: view.final for i, view in chosen.items()}}
    sizes = {i: (camera.width, camera.height) for i, camera in large.items()}
    return {
        kind: compare_points(
            {pair: matches[pair] for pair in pairs[kind] if pair in matches},
            before, after[kind], sizes, kind,
        )
        for kind in pairs
        if pairs[kind]
    }  # fmt: skip


def _missing(
    subject: EvaluationInput, measured: Mapping[str, Mapping[Group, Mean]]
) -> dict[str, str]:
    """Reasons by the name of the metric, or of the metric and the role that has no value."""
    found: dict[str, str] = {}
    for row in METRICS.values():
        if row.name not in measured:
            found[row.name] = why_missing(row, subject)
            continue
        for role in row.needs.roles:
            if role != "all" and role not in measured[row.name]:
                found[f"{row.name} at {role} views"] = why_missing_at(role, subject)
    return {name: reason for name, reason in found.items() if reason}


def _missing_pairs(
    subject: EvaluationInput,
    warp: Sequence[PairComparison],
    points: Mapping[PicturesOf, PairComparison | str],
) -> dict[str, str]:
    """Reasons why pairs of views were not compared, by the name of the row."""
    rows = {row.name for row in warp}
    found = {}
    for name in PAIRS:
        kind, pictures, *range_ = name.split("_")
        point = points.get("targets" if pictures == "targets" else "renders")
        if name in rows or (isinstance(point, PairComparison) and kind == "points"):
            continue
        if subject.unedited is None:
            found[name] = NO_UNEDITED
        elif pictures == "targets" and not subject.targets:
            found[name] = subject.no_targets
        elif kind == "points":
            found[name] = point or _why_no_points(pictures, subject)
        else:
            found[name] = _why_no_warp(pictures, range_ == ["long"], subject)
    return found


def _why_no_warp(pictures: str, long: bool, subject: EvaluationInput) -> str:
    held_out = len(subject.views.having("held_out"))
    if long and subject.quick:
        return LATER
    if pictures == "targets":
        if sum(i in subject.targets for i in subject.views.having("edited")) < 2:
            return "two edited views with a picture are needed: add pictures of edited views"
    elif held_out < 1 + long:
        return (
            "two held-out views are needed: add some to the list"
            if long
            else "a held-out view is needed: add one to the list"
        )
    return "no two views share 1 % of their pixels: add views that see each other"


def _why_no_points(pictures: str, subject: EvaluationInput) -> str:
    if subject.matcher is None:
        return NO_MATCHER
    which = "edited views with a picture" if pictures == "targets" else "held-out views"
    return f"two {which} that look in similar directions are needed: add views to the list"


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
        "measured": {**evaluation.record(), **against.cost},
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
    heads = {"warp error": evaluation.warp, "difference at SIFT matches": evaluation.points}
    for what, rows in heads.items():
        if rows:
            lines += ["", _line(f"{what} (RMSE)", "unedited", "edited", "excess")]
            lines += [_pair_line(row, targets) for row in rows]
    if cost:
        lines += ["", *(f"{COST[name]:<{LABEL}}{cost[name]:>{NUMBER}.0f}" for name in cost)]
    lines += _notes(evaluation, targets)
    missing = {**evaluation.not_measured, **missing_cost(against)}
    return "\n".join([*lines, *_left_out(missing, targets)])


def _line(label: str, *cells: str) -> str:
    widths = (NUMBER, NUMBER, COLUMNS - LABEL - 2 * NUMBER)
    return (
        f"{label:<{LABEL}}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths))
    ).rstrip()


def _cell(mean: Mean | None, decimals: int) -> str:
    return "-" if mean is None else f"{mean.value:.{decimals}f}"


def _pair_line(row: PairComparison, targets: str) -> str:
    kind = targets if row.pictures == "targets" else "renders, held out"
    label = f"{kind}, {row.range} range ({row.pairs} pairs)"
    if row.range is None:
        label = f"{kind} ({row.counts['points']} points)"
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


def _left_out(reasons: Mapping[str, str], targets: str) -> list[str]:
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
