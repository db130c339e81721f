"""Plots of the paper's experiments, as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from gsedit.measures.decibels import psnr_from_rmse
from research.figures import DPI, frame, plain_ticks, save_png
from research.paper.arms import (
    COMBINED,
    DEFAULT,
    ITERATIVE,
    PAPER,
    SHARED_ITERATIVE,
    T_END_STEPS,
    base_of,
    t_end_label,
)
from research.paper.costs import CONDITIONS, PAPER_EVALUATION, PAPER_STEP, regimes
from research.paper.runs import Run
from research.paper.statistics import spread
from research.paper.studies import BRANCHES, CLOSED_FORM, SMALL, VARIED, Study
from research.paper.summary import RATIOS, Records
from research.paper.tables import COLUMNS, change, factorial_effects

STYLES = {
    PAPER: ("#0072B2", "o"),
    DEFAULT: ("#009E73", "^"),
    ITERATIVE: ("#D55E00", "s"),
    SHARED_ITERATIVE: ("#E69F00", "v"),
    COMBINED: ("#CC79A7", "D"),
}
"""Okabe and Ito's colors, which color-blind readers tell apart, and a marker each."""
EDITORS = {CLOSED_FORM: ("#0072B2", "o"), VARIED: ("#D55E00", "s"), SMALL: ("#009E73", "^")}
NOT_REACHED = 0.2
"""Height at which a speed-up of 0 is drawn."""
SAMPLES = 60
"""Times at which curves of several runs are averaged."""
SHOWN = ("final_db", "disagreement", "sharpness")
"""Metrics of the plots of changes."""


def error_curves(studies: Sequence[Study], records: Records, real: float, path: Path) -> None:
    """Error over seconds at two costs, and over editor calls; a row an editor and scene kind."""
    groups: dict[str, dict[str, Run]] = {}
    for run in (run for study in studies for run in study.runs):
        if run.key in records and run.arm.label in STYLES:
            where = "captures" if run.case.scene else "synthetic scenes"
            groups.setdefault(f"{run.editor}, {where}", {})[run.key] = run
    figure, panels = _figure(len(groups), 3)
    handles: dict[str, Any] = {}
    for line, (name, runs) in zip(panels, groups.items()):
        own = list(runs.values())
        at = regimes(real, BRANCHES[own[0].editor])
        columns = (
            ("processor seconds, as measured", at["measured"].seconds),
            ("hours, InstructPix2Pix here", lambda p, at=at: at["real"].seconds(p) / 3600),
            ("views that the editor was asked for", lambda p: float(p.calls)),
        )
        for axes, (label, cost) in zip(line, columns):
            frame(axes, name, 9)
            handles |= _curves(axes, own, records, cost)
            axes.set_xscale("log")
            axes.set_xlabel(label, fontsize=8)
            axes.tick_params(labelsize=8)
            plain_ticks(axes)
        line[0].set_ylabel("PSNR to the reference, dB", fontsize=8)
    _save(figure, "How soon an edit is right, at held-out cameras", handles, path)


def similarity_curves(study: Study, records: Records, path: Path) -> None:
    """CLIP's similarity over editor calls, the mean of all repetitions; nothing without it."""
    runs = [r for r in study.runs if r.key in records and records[r.key].similarity]
    if not runs:
        return
    figure, panels = _figure(1, 1, width=6.0)
    axes = panels[0][0]
    frame(axes, "", 9)
    handles = _curves(axes, runs, records, lambda p: float(p.calls), similar=True)
    axes.set_xlabel("views that the editor was asked for", fontsize=8)
    axes.set_ylabel("CLIP text-image similarity", fontsize=8)
    _save(figure, f"{len(runs)} runs, mean and standard deviation", handles, path)


def _curves(
    axes: Any, runs: Sequence[Run], records: Records, cost: Callable[[Any], float],
    *, similar: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """A line an arm: the mean over scenes and seeds, and one standard deviation. A run that has
    ended stays as it is until the last one has."""
    import numpy as np

    handles = {}
    for label, (color, marker) in STYLES.items():
        group = [records[run.key] for run in runs if run.arm.label == label]
        costs = [[cost(point) for point in record.curve] for record in group]
        ends = [c[-1] for c in costs if c[-1] > 0]
        firsts = [x for c in costs for x in c if x > 0]
        if not ends:
            continue
        grid = np.geomspace(max(min(firsts), min(ends) / 300), max(ends), SAMPLES).tolist()
        values = [
            list(r.similarity) if similar else [psnr_from_rmse(e) for e in r.errors] for r in group
        ]
        rows = [_stepped(c, v, grid) for c, v in zip(costs, values)]
        mean, deviation = np.mean(rows, 0), np.std(rows, 0)
        (handles[label],) = axes.plot(
            grid, mean, color=color, marker=marker, markevery=12, markersize=4, linewidth=1.4
        )
        axes.fill_between(grid, mean - deviation, mean + deviation, color=color, alpha=0.12, lw=0)
    return handles


def _stepped(costs: Sequence[float], values: Sequence[float], grid: Sequence[float]) -> list[float]:
    """The value of the last point at most at each cost."""
    found = []
    for x in grid:
        before = [e for c, e in zip(costs, values) if c <= x]
        found.append(before[-1] if before else values[0])
    return found


def speed_ups(summary: Mapping[str, Any], path: Path) -> None:
    """The median speed-up over the cost of an evaluation; a panel an editor."""
    editors = list(dict.fromkeys(race["editor"] for race in summary["races"]))
    figure, panels = _figure(1, max(len(editors), 1), width=4.2, height=3.2)
    handles: dict[str, Any] = {}
    for axes, editor in zip(panels[0], editors):
        frame(axes, editor, 9)
        for label, (color, marker) in STYLES.items():
            group = [
                race["by_ratio"]
                for race in summary["races"]
                if (race["editor"], race["arm"]) == (editor, label)
            ]
            if group:
                shown = [max(median(factors), NOT_REACHED) for factors in zip(*group)]
                (handles[label],) = axes.plot(
                    RATIOS, shown, color=color, marker=marker, markevery=4, markersize=4, lw=1.4
                )
        _mark_costs(axes, summary, editor)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("cost of an evaluation, in fitting steps", fontsize=8)
        axes.set_ylabel("times sooner than iterative", fontsize=8)
        axes.tick_params(labelsize=8)
    title = f"How much sooner iterative's final error is reached ({NOT_REACHED}: not; dashed: 10)"
    _save(figure, title, handles, path)


def _mark_costs(axes: Any, summary: Mapping[str, Any], editor: str) -> None:
    step, evaluation = (
        median(race[name] for race in summary["races"] if race["editor"] == editor)
        for name in ("step_s", "evaluation_s")
    )
    times = CONDITIONS / BRANCHES[editor]
    real = times * summary["costs"]["real_evaluation_seconds"]
    marks = {"paper, A100": times * PAPER_EVALUATION / PAPER_STEP}
    marks |= {"InstructPix2Pix here": real / step, "measured": evaluation / step}
    for name, x in marks.items():
        axes.axvline(x, color="#999999", linewidth=0.9, linestyle=":")
        axes.annotate(name, (x, 0.02), xycoords=("data", "axes fraction"), rotation=90,
                      fontsize=7, va="bottom", ha="right", color="#666666")  # fmt: skip
    axes.axhline(10, color="#bbbbbb", linewidth=0.9, linestyle="--")
    axes.axhline(1, color="#bbbbbb", linewidth=0.9)


def changes(summary: Mapping[str, Any], preset: str, path: Path) -> None:
    """The effect of one change on each metric: a row a change, a color an editor."""
    arms = dict.fromkeys(row["arm"] for row in summary["rows"])
    t_end = [t_end_label(steps) for steps in T_END_STEPS]
    labels = [a for a in arms if a.startswith(f"{preset}: ") and a not in t_end]
    editors = list(dict.fromkeys(row["editor"] for row in summary["rows"]))
    names = [label.partition(": ")[2] for label in labels]
    for k, label in enumerate(labels):
        if (base := base_of(label)) != preset:
            names[k] += f" (from {(base or '').partition(': ')[2]})"
    found = [
        [[change(summary, label, base_of(label) or "", e, metric) for label in labels]
         for e in editors]
        for metric in SHOWN
    ]  # fmt: skip
    _forest(found, names, editors, f"{preset}, with one change each; intervals of 95 %", path)


def factorial(summary: Mapping[str, Any], path: Path) -> None:
    """The effect of each part of the default on the edited scene, alone and two together."""
    effects = {name: factorial_effects(summary, name) for name in SHOWN}
    labels = list(effects["final_db"])
    found = [[[effects[metric].get(label) for label in labels]] for metric in SHOWN]
    names = [label.replace(" and ", " x ") for label in labels]
    title = "Each part of the default: with it, less without; intervals of 95 % (x: two together)"
    _forest(found, names, [SMALL], title, path)


def _forest(
    found: Sequence[Sequence[Sequence[Any]]], names: Sequence[str], groups: Sequence[str],
    title: str, path: Path,
) -> None:  # fmt: skip
    """Effects with intervals: found[metric][group][row]."""
    if not names:
        return
    figure, panels = _figure(1, len(SHOWN), width=3.4, height=0.8 + 0.3 * len(names), sharey=True)
    handles: dict[str, Any] = {}
    for axes, metric, of_groups in zip(panels[0], SHOWN, found):
        frame(axes, "", 9)
        axes.axvline(0, color="#666666", linewidth=0.9)
        for k, (group, judged) in enumerate(zip(groups, of_groups)):
            color, marker = EDITORS[group]
            for row, each in enumerate(judged):
                if each is None:
                    continue
                y = row + 0.22 * (k - (len(groups) - 1) / 2)
                if each.has_interval:
                    axes.plot([each.low, each.high], [y, y], color=color, linewidth=1.3)
                (dot,) = axes.plot([each.effect], [y], marker, color=color, markersize=4)
                handles[group] = dot
        axes.set_title(_title(metric), fontsize=8, loc="left")
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.locator_params(axis="x", nbins=5)
        axes.tick_params(labelsize=8)
    _save(figure, title, handles, path)


def t_end_curves(summary: Mapping[str, Any], path: Path) -> None:
    """Metrics over the number of steps with averaging; a line an editor."""
    names = ("disagreement", "target_sharpness", "target_db", "final_db")
    figure, panels = _figure(1, len(names), width=2.9)
    handles: dict[str, Any] = {}
    rows = [row for row in summary["rows"] if row["study"] in ("t-end", "paper")]
    places = {(r["editor"], r["scene"], r["seed"]) for r in rows if r["study"] == "t-end"}
    rows = [r for r in rows if (r["editor"], r["scene"], r["seed"]) in places]
    editors = dict.fromkeys(row["editor"] for row in rows)
    for axes, name in zip(panels[0], names):
        frame(axes, _title(name), 8)
        for editor in editors:
            color, marker = EDITORS[editor]
            by_steps = [
                spread(r[name] for r in rows
                       if (r["arm"], r["editor"]) == (t_end_label(steps), editor))
                for steps in T_END_STEPS
            ]  # fmt: skip
            shown = [(x, s) for x, s in zip(T_END_STEPS, by_steps) if s]
            if shown:
                handles[editor] = axes.errorbar(
                    [x for x, _ in shown], [s.mean for _, s in shown],
                    [s.deviation for _, s in shown], color=color, marker=marker,
                    markersize=4, linewidth=1.2, capsize=2,
                )  # fmt: skip
        axes.set_xlabel("averaged steps of 50", fontsize=8)
        axes.tick_params(labelsize=8)
    _save(figure, "Steps in which views are averaged (T_end)", handles, path)


def _title(metric: str) -> str:
    return COLUMNS[metric][0].replace(" between near views", "")


def _figure(
    lines: int, columns: int, *, width: float = 3.3, height: float = 2.6, sharey: bool = False
) -> tuple[Any, Any]:
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    size = (max(width * columns, 6.0), height * max(lines, 1) + 0.8)
    figure = Figure(figsize=size, dpi=DPI)
    return figure, figure.subplots(max(lines, 1), columns, squeeze=False, sharey=sharey)


def _save(figure: Any, title: str, handles: Mapping[str, Any], path: Path) -> None:
    height = figure.get_figheight()
    figure.suptitle(title, x=0.01, y=1 - 0.06 / height, ha="left", va="top", fontsize=11)
    if handles:
        figure.legend(
            handles=list(handles.values()), labels=list(handles), loc="lower left", frameon=False,
            ncols=min(len(handles), 6), fontsize=8, bbox_to_anchor=(0.005, 0.0),
        )  # fmt: skip
    figure.tight_layout(rect=(0, 0.32 / height, 1, 1 - 0.1 / height))
    save_png(figure, path, overwrite=True)
