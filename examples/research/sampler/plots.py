"""Plots of the sampler's measurements: work and precision, and the sweep of T_end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

from research.figures import DPI, frame, plain_ticks, save_png
from research.sampler.measurements import SamplerMeasurement

Cost = Literal["evaluations", "seconds"]

# Okabe and Ito's colors, which color-blind readers tell apart; each line has its own marker
SOLVERS = {
    "ddim": ("#0072B2", "o", "DDIM = Euler"),
    "heun": ("#009E73", "s", "Heun, two a step"),
    "dpm++2m": ("#D55E00", "^", "DPM-Solver++(2M)"),
}
LINES = (
    ("#D55E00", "^"), ("#0072B2", "o"), ("#009E73", "s"), ("#CC79A7", "D"),
)  # fmt: skip
FLOOR, CEILING = 1e-10, 1e3
"""Errors beyond are drawn at the edge: a result that left the data is wrong at any distance."""
PANEL = (3.1, 2.7)  # inches
MEASURES = {
    "deviation": "signed deviation of views",
    "contrast": "contrast kept",
    "strength": "edit strength (RMS)",
}


def work_precision(
    rows: Iterable[SamplerMeasurement], path: Path, cost: Cost, *, overwrite: bool = False
) -> None:
    """A PNG: error over evaluations or seconds, a panel a problem, a line of panels a guidance."""
    measured = [row for row in rows if row.study == "solver" and row.error is not None]
    problems = list(dict.fromkeys(row.problem for row in measured))
    widths = list(dict.fromkeys(name.split(", ")[0] for name in problems))
    scales = list(dict.fromkeys(name.split(", ")[1] for name in problems))
    figure, panels = _figure(len(scales), len(widths), sharey=True)
    handles: dict[str, Any] = {}
    for name in problems:
        width, scale = name.split(", ")
        axes = panels[scales.index(scale)][widths.index(width)]
        handles |= _problem_panel(axes, name, [r for r in measured if r.problem == name], cost)
    for axes in panels[-1]:
        axes.set_xlabel("evaluations of the network" if cost == "evaluations" else "seconds")
    for line in panels:
        line[0].set_ylabel("RMS error")
    title = "Error of each solver against the ODE's exact path, in the data's standard deviation"
    _save(figure, title, handles, path, overwrite)


def _problem_panel(
    axes: Any, name: str, rows: Sequence[SamplerMeasurement], cost: Cost
) -> dict[str, Any]:
    """A line a solver; what the legend has to explain."""
    _decorate(axes, name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    if cost == "evaluations":
        _guides(axes, rows)
    handles = {}
    for solver, (color, marker, label) in SOLVERS.items():
        points = [row for row in rows if row.variant == solver]
        errors = [min(max(row.error or 0.0, FLOOR), CEILING) for row in points]
        (handles[label],) = axes.plot(
            [getattr(row, cost) for row in points], errors, color=color, marker=marker,
            markersize=4.5, linewidth=1.2, label=label,
        )  # fmt: skip
    plain_ticks(axes)
    return handles


def _guides(axes: Any, rows: Sequence[SamplerMeasurement]) -> None:
    """Slopes of first and second order, dashed."""
    low, high = min(row.evaluations for row in rows), max(row.evaluations for row in rows)
    anchor = max(min(max(row.error or 0 for row in rows), 1.0), FLOOR)
    for order in (1, 2):
        ends = [anchor, anchor * (low / high) ** order]
        axes.plot((low, high), ends, color="#bbbbbb", linewidth=0.9, linestyle="--", zorder=1)
        axes.annotate(f"1/N{'²' * (order == 2)}", (high, ends[1]), fontsize=7, color="#888888",
                      ha="right", va="bottom")  # fmt: skip


def sweep_plot(rows: Iterable[SamplerMeasurement], path: Path, *, overwrite: bool = False) -> None:
    """A PNG of three measures over T_end: a line of panels a scene, a curve a variant."""
    swept = [row for row in rows if row.study == "consensus" and row.t_end is not None]
    scenes = [(name, list(group)) for name, group in groupby(swept, key=lambda row: row.problem)]
    figure, panels = _figure(max(len(scenes), 1), len(MEASURES))
    handles: dict[str, Any] = {}
    for (name, group), line in zip(scenes, panels):
        variants = list(dict.fromkeys(row.variant for row in group))
        for axes, (measure, label) in zip(line, MEASURES.items()):
            _decorate(axes, f"{name.removesuffix(', T_end')}: {label}")
            for variant, (color, marker) in zip(variants, LINES):
                points = [row for row in group if row.variant == variant]
                (handles[variant],) = axes.plot(
                    [row.t_end for row in points], [getattr(row, measure) for row in points],
                    color=color, marker=marker, markersize=5, label=variant,
                )  # fmt: skip
            values = [getattr(row, measure) for row in group]
            axes.set_ylim(1.1 * min(0, *values), 1.1 * max(values) or 1)
            axes.axhline(0, color="#888888", linewidth=0.8, zorder=1)
    for axes in panels[-1]:
        axes.set_xlabel("T_end: steps with consensus, of 50")
    title = "Steps with consensus: agreement of views, and what it costs in contrast and strength"
    _save(figure, title, handles, path, overwrite)


def _figure(lines: int, columns: int, *, sharey: bool = False) -> tuple[Any, Any]:
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    height = PANEL[1] * lines + 0.75
    figure = Figure(figsize=(max(PANEL[0] * columns, 6.5), height), dpi=DPI)
    panels = figure.subplots(max(lines, 1), max(columns, 1), squeeze=False, sharey=sharey)
    return figure, panels


def _decorate(axes: Any, title: str) -> None:
    frame(axes, title, fontsize=9)
    axes.tick_params(labelsize=8)


def _save(figure: Any, title: str, handles: dict[str, Any], path: Path, overwrite: bool) -> None:
    height = figure.get_figheight()
    figure.suptitle(title, x=0.01, y=1 - 0.06 / height, ha="left", va="top", fontsize=11)
    if handles:
        figure.legend(
            handles=list(handles.values()), labels=list(handles), loc="lower left", frameon=False,
            ncols=len(handles), fontsize=9, bbox_to_anchor=(0.005, 0.0),
        )  # fmt: skip
    figure.tight_layout(rect=(0, 0.3 / height, 1, 1))
    save_png(figure, path, overwrite=overwrite)
