"""Plots of the paper's experiments, as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gsedit.measures.decibels import psnr_from_rmse
from research.figures import DPI, frame, plain_ticks, save_png
from research.paper.runs import Record, Run
from research.paper.statistics import (
    COSTLY,
    COSTLY_SECONDS,
    MEASURED,
    PAPER_EVALUATION,
    PAPER_STEP,
)
from research.paper.studies import (
    BULK,
    COMBINED,
    ITERATIVE,
    SDS,
    SHORTER,
    SINGLE_PASS,
    T_END_STEPS,
    Study,
)

STYLES = {
    SINGLE_PASS: ("#0072B2", "o"),
    ITERATIVE: ("#D55E00", "s"),
    SHORTER: ("#E69F00", "v"),
    COMBINED: ("#009E73", "^"),
    BULK: ("#CC79A7", "D"),
    SDS: ("#555555", "P"),
}
"""Okabe and Ito's colors, which color-blind readers tell apart, and a marker each."""
OTHERS = (("#0072B2", "o"), ("#D55E00", "s"))
NOT_REACHED = 0.2
"""Height at which a speed-up of 0 is drawn."""
SAMPLES = 60
"""Times at which curves of several runs are averaged."""

Records = Mapping[str, Record]


def error_curves(study: Study, records: Records, path: Path) -> None:
    """Error over seconds at both costs, and over editor calls; a row an editor and scene kind."""
    groups: dict[str, list[Run]] = {}
    for run in study.runs:
        if run.key in records:
            where = "capture" if run.case.scene else "synthetic scenes"
            groups.setdefault(f"{run.editor}, {where}", []).append(run)
    figure, panels = _figure(len(groups), 3)
    handles: dict[str, Any] = {}
    for line, (name, runs) in zip(panels, groups.items()):
        columns = (
            ("seconds, as measured", MEASURED.seconds),
            ("hours, an editor of Stable Diffusion's cost", lambda p: COSTLY.seconds(p) / 3600),
            ("views that the editor was asked for", lambda p: float(p.calls)),
        )
        for axes, (label, cost) in zip(line, columns):
            frame(axes, name, 9)
            handles |= _curves(axes, runs, records, cost)
            axes.set_xscale("log")
            axes.set_xlabel(label, fontsize=8)
            axes.tick_params(labelsize=8)
            plain_ticks(axes)
        line[0].set_ylabel("PSNR to what is right, dB", fontsize=8)
    _save(figure, "How soon an edit is right, at held-out cameras", handles, path)


def _curves(
    axes: Any, runs: Sequence[Run], records: Records, cost: Callable[[Any], float]
) -> dict[str, Any]:
    """A line an arm: the mean over scenes and seeds, and one standard deviation."""
    import numpy as np

    handles = {}
    for label, (color, marker) in STYLES.items():
        group = [records[run.key] for run in runs if run.arm.label == label]
        costs = [[cost(point) for point in record.curve] for record in group]
        ends = [c[-1] for c in costs if c[-1] > 0]
        firsts = [x for c in costs for x in c if x > 0]
        if not ends:
            continue
        grid = np.geomspace(max(min(firsts), min(ends) / 300), min(ends), SAMPLES).tolist()
        rows = [
            [psnr_from_rmse(e) for e in _stepped(c, r.errors, grid)] for c, r in zip(costs, group)
        ]
        mean, deviation = np.mean(rows, 0), np.std(rows, 0)
        (handles[label],) = axes.plot(
            grid, mean, color=color, marker=marker, markevery=12, markersize=4, linewidth=1.4
        )
        axes.fill_between(grid, mean - deviation, mean + deviation, color=color, alpha=0.12, lw=0)
    return handles


def _stepped(costs: Sequence[float], errors: Sequence[float], grid: Sequence[float]) -> list[float]:
    """The error of the last point at most at each cost."""
    found = []
    for x in grid:
        before = [e for c, e in zip(costs, errors) if c <= x]
        found.append(before[-1] if before else errors[0])
    return found


def speed_ups(editors: Mapping[str, Any], path: Path) -> None:
    """The speed-up on the median scene over the cost of an evaluation; a panel an editor."""
    figure, panels = _figure(1, max(len(editors), 1), width=4.6, height=3.2)
    handles: dict[str, Any] = {}
    for axes, (editor, numbers) in zip(panels[0], editors.items()):
        frame(axes, editor, 9)
        ratios = numbers["speed_up_by_ratio"]["ratios"]
        for label, factors in numbers["speed_up_by_ratio"]["arms"].items():
            color, marker = STYLES.get(label, OTHERS[0])
            shown = [max(f or 0, NOT_REACHED) for f in factors]
            (handles[label],) = axes.plot(
                ratios, shown, color=color, marker=marker, markevery=4, markersize=4, linewidth=1.4
            )
        step = numbers["fitting_step_seconds"]["median"]
        own = numbers["evaluation_seconds"]["median"]
        marks = {"paper, A100": PAPER_EVALUATION / PAPER_STEP}
        if step:
            marks |= {"Stable Diffusion here": COSTLY_SECONDS / step} | (
                {"measured": own / step} if own else {}
            )
        for name, x in marks.items():
            axes.axvline(x, color="#999999", linewidth=0.9, linestyle=":")
            axes.annotate(name, (x, 0.1), xycoords=("data", "axes fraction"), rotation=90,
                          fontsize=7, va="bottom", ha="right", color="#666666")  # fmt: skip
        axes.axhline(10, color="#bbbbbb", linewidth=0.9, linestyle="--")
        axes.axhline(1, color="#bbbbbb", linewidth=0.9)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("cost of an evaluation, in fitting steps", fontsize=8)
        axes.set_ylabel("times sooner than iterative", fontsize=8)
        axes.tick_params(labelsize=8)
    title = (
        f"How much sooner iterative's final error is reached ({NOT_REACHED}: it is not; dashed: 10)"
    )
    _save(figure, title, handles, path)


MEASURES: dict[str, tuple[str, Callable[[Record], float | None]]] = {
    "disagreement": ("edited pictures differ\nbetween near views, RMSE", lambda r: r.disagreement),
    "sharpness": (
        "sharpness of edited pictures,\n1 as the exact edit",
        lambda r: r.target_sharpness,
    ),
    "target": ("edited pictures to the\nexact edit, dB", lambda r: _db(r.target_error)),
    "final": ("edited scene to the\nexact edit, dB", lambda r: _db(r.errors[-1])),
    "scene sharpness": (
        "sharpness of the edited scene,\n1 as the exact edit",
        lambda r: r.sharpness,
    ),
}
PICTURES = ("disagreement", "sharpness", "target", "final")


def t_end_curves(study: Study, records: Records, path: Path) -> None:
    """Measures over the number of steps with averaging; a line a way of averaging."""
    figure, panels = _figure(1, len(PICTURES), width=2.7)
    handles: dict[str, Any] = {}
    bases = list(dict.fromkeys(run.arm.label.rpartition(":")[0] for run in study.runs))
    for axes, name in zip(panels[0], PICTURES):
        label, measure = MEASURES[name]
        frame(axes, "", 9)
        for base, (color, marker) in zip(bases, OTHERS):
            means, deviations = [], []
            for averaged in T_END_STEPS:
                mean, deviation = _mean(study, records, f"{base}: {averaged}", measure)
                means.append(mean)
                deviations.append(deviation)
            handles[base] = axes.errorbar(
                T_END_STEPS, means, deviations, color=color, marker=marker, markersize=4,
                linewidth=1.4, capsize=2, elinewidth=0.8,
            )  # fmt: skip
        axes.set_xlabel("averaged steps of 50", fontsize=8)
        axes.set_title(label, fontsize=8, loc="left")
        axes.tick_params(labelsize=8)
    _save(figure, "Steps in which views are averaged (T_end)", handles, path)


def dots(study: Study, records: Records, names: Sequence[str], path: Path) -> None:
    """A row an arm: every run as a dot, their mean as a bar; a panel a measure."""
    labels = list(dict.fromkeys(run.arm.label for run in study.runs))
    figure, panels = _figure(1, len(names), width=3.0, height=0.9 + 0.32 * len(labels), sharey=True)
    scenes = list(dict.fromkeys(run.case.name for run in study.runs))
    colors = [color for color, _ in STYLES.values()]
    handles: dict[str, Any] = {}
    for axes, name in zip(panels[0], names):
        title, measure = MEASURES[name]
        frame(axes, "", 9)
        for row, label in enumerate(labels):
            for scene, color in zip(scenes, colors):
                values = _values(study, records, label, measure, scene)
                (dot,) = axes.plot(values, [row] * len(values), "o", color=color, markersize=4,
                                   alpha=0.7, linestyle="none")  # fmt: skip
                if values:
                    handles[scene] = dot
            everything = _values(study, records, label, measure)
            if everything:
                mean = sum(everything) / len(everything)
                axes.plot([mean, mean], [row - 0.3, row + 0.3], color="black", linewidth=1.6)
        axes.set_title(title, fontsize=8, loc="left")
        axes.set_yticks(range(len(labels)), labels, fontsize=8)
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.tick_params(labelsize=8)
    _save(figure, study.title, handles, path)


def combined_curves(study: Study, records: Records, path: Path) -> None:
    """Error over the steps of iterative, from scratch and after the single pass."""
    editors = list(dict.fromkeys(run.editor for run in study.runs if run.key in records))
    figure, panels = _figure(1, max(len(editors), 1), width=4.0)
    handles: dict[str, Any] = {}
    for axes, editor in zip(panels[0], editors):
        frame(axes, editor, 9)
        runs = [run for run in study.runs if run.editor == editor and run.key in records]
        first = {
            (run.case, run.seed): records[run.key].curve[-1].steps
            for run in runs
            if run.arm.label == SINGLE_PASS
        }
        for label in (ITERATIVE, COMBINED):
            color, marker = STYLES[label]
            for run in (run for run in runs if run.arm.label == label):
                record = records[run.key]
                begun = first.get((run.case, run.seed), 0) if label == COMBINED else 0
                points = [
                    (p.steps - begun, psnr_from_rmse(e))
                    for p, e in zip(record.curve, record.errors)
                    if p.steps >= begun
                ]
                (handles[label],) = axes.plot(
                    *zip(*points), color=color, linewidth=1.1, alpha=0.7, marker=marker,
                    markevery=[len(points) - 1], markersize=4,
                )  # fmt: skip
        axes.set_xlabel("steps of iterative", fontsize=8)
        axes.set_ylabel("PSNR to what is right, dB", fontsize=8)
        axes.tick_params(labelsize=8)
    _save(figure, "Iterative from scratch, and after the single pass", handles, path)


def _values(
    study: Study,
    records: Records,
    label: str,
    measure: Callable[[Record], float | None],
    scene: str | None = None,
) -> list[float]:
    found = [
        measure(records[run.key])
        for run in study.runs
        if run.arm.label == label and run.key in records and scene in (None, run.case.name)
    ]
    return [value for value in found if value is not None]


def _mean(
    study: Study, records: Records, label: str, measure: Callable[[Record], float | None]
) -> tuple[float, float]:
    """Mean and standard deviation (of the population); nan where nothing was measured."""
    import numpy as np

    values = _values(study, records, label, measure)
    return (float(np.mean(values)), float(np.std(values))) if values else (np.nan, np.nan)


def _db(error: float | None) -> float | None:
    return None if error is None else psnr_from_rmse(max(error, 1e-5))


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
