"""Work-precision plots: error against seconds on logarithmic axes, one panel a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby, product
from pathlib import Path
from typing import Any, Literal, NamedTuple

from research.curves import Point
from research.figures import DPI, frame, plain_ticks, save_png
from research.renderer.measurements import RenderMeasurement
from research.renderer.pareto import pareto

Which = Literal["image", "gradients"]

# Okabe and Ito's colors, which color-blind readers tell apart; each knob has its own marker
STYLES = {
    "floor": ("#0072B2", "o", "alpha floor"),
    "stop": ("#009E73", "s", "stop"),
    "tile": ("#E69F00", "^", "tile side, pixels"),
    "block": ("#CC79A7", "D", "block"),
    "resolution": ("#56B4E9", "v", "resolution, then enlarged"),
    "degree": ("#8C6D1F", "p", "SH degree"),
    "dtype": ("#6A51A3", "P", "float64"),
    "cull": ("#D55E00", "X", "cull by box"),
    "kernel": ("#B2182B", "h", "torch"),
    "baseline": ("#555555", "<", "textbook conic, float32"),
    "peers": ("#000000", ">", "other renderers"),
}
NAMED = ("floor", "stop", "tile", "block", "resolution", "degree", "peers")
"""Knobs whose points need their value written beside them."""
FLOOR = 1e-10
"""Smaller errors are drawn here, with their value: zero has no logarithm."""
PANEL = (5.2, 4.3)  # inches
TOP, LEGEND_ROW, LEGEND_COLUMN = 0.9, 0.2, 1.75  # inches


Box = tuple[float, float, float, float]
"""Left, bottom, right, top, pixels."""


class _Mark(NamedTuple):
    """A point of a plot."""

    seconds: float
    error: float
    knob: str
    value: str


def work_precision(
    rows: Iterable[RenderMeasurement], path: Path, which: Which, *, overwrite: bool = False
) -> None:
    """A PNG of the rows: mean error of a color over the forward pass's seconds, or the worst
    gradient's relative error over those of forward and backward. Needs no screen.
    """
    rows = list(rows)
    scenes = {name: list(group) for name, group in groupby(rows, key=lambda row: row.scene)}
    marks = {
        name: [m for row in group if (m := _mark(row, which))] for name, group in scenes.items()
    }
    figure, panels, across = _figure(len(scenes))
    handles: dict[str, Any] = {}
    for axes, (name, group) in zip(panels, scenes.items()):
        handles |= _panel(axes, name, group[0], marks[name], which)
    for axes in panels[len(scenes) :]:
        axes.set_axis_off()
    _title(figure, rows, which)
    _legend(figure, handles, across)
    figure.draw_without_rendering()  # text has its place only now
    for axes, scene_marks in zip(panels, marks.values()):
        _name_points(axes, scene_marks)
    save_png(figure, path, overwrite=overwrite)


def _figure(count: int) -> tuple[Any, Any, int]:
    """A figure of so many panels and room for title and legend; its panels; legend columns."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    lines = max(1, math.ceil(count / 3))
    columns = max(1, math.ceil(count / lines))
    across = int(PANEL[0] * columns / LEGEND_COLUMN)
    bottom = LEGEND_ROW * (1 + math.ceil((len(STYLES) + 2) / across))
    height = PANEL[1] * lines + TOP + bottom
    room = (0.004, bottom / height, 0.99, 1 - (TOP + bottom) / height)
    layout = ConstrainedLayoutEngine(rect=room, wspace=0.05, hspace=0.05)
    figure = Figure(figsize=(PANEL[0] * columns, height), dpi=DPI, layout=layout)
    return figure, figure.subplots(lines, columns, squeeze=False).flatten(), across


def _mark(row: RenderMeasurement, which: Which) -> _Mark | None:
    image = which == "image"
    seconds = row.forward_wall if image else row.both_wall
    error = row.error_mean if image else row.gradient_error
    if not seconds or error is None or not math.isfinite(error):
        return None
    value = row.implementation if row.knob == "peers" else row.value
    if error < FLOOR:
        value = f"{value} ({error:.0e})"
    return _Mark(seconds, max(error, FLOOR), row.knob, value)


def _panel(
    axes: Any, name: str, row: RenderMeasurement, marks: Sequence[_Mark], which: Which
) -> dict[str, Any]:
    """Draw points and front of a scene; handles for the legend, by knob."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    frame(axes, f"{name}: {row.gaussians:,} Gaussians", fontsize=11)
    axes.set_xlabel("forward, seconds" if which == "image" else "forward + backward, seconds")
    axes.set_ylabel(
        "mean error of a color in [0, 1]" if which == "image" else "worst gradient's relative error"
    )
    handles = _front(axes, [(m.seconds, m.error) for m in marks])
    for knob, members in groupby(marks, key=lambda mark: mark.knob):
        group = list(members)
        x, y = [m.seconds for m in group], [m.error for m in group]
        if knob == "default":
            style = {"color": "black", "marker": "*", "markersize": 18, "zorder": 3}
            (handles["default"],) = axes.plot(x, y, linestyle="none", label="the defaults", **style)
            continue
        color, marker, label = STYLES[knob]
        joined = "-" if knob not in ("peers", "baseline") else "none"
        (handles[knob],) = axes.plot(
            x, y, marker=marker, color=color, linestyle=joined, linewidth=0.6, label=label,
            markersize=7, markeredgecolor="white", markeredgewidth=0.6, zorder=4,
        )  # fmt: skip
    axes.margins(0.14)
    plain_ticks(axes)
    return handles


def _front(axes: Any, points: Sequence[Point]) -> dict[str, Any]:
    """The Pareto front as steps: the least error reached within so many seconds."""
    front = pareto(points)
    if not front:
        axes.text(0.5, 0.5, "nothing was measured", ha="center", transform=axes.transAxes)
        return {}
    line = {"color": "#bbbbbb", "linewidth": 4.5, "solid_capstyle": "round", "zorder": 1}
    (drawn,) = axes.plot(*zip(*front), drawstyle="steps-post", label="Pareto front", **line)
    return {"front": drawn}


def _title(figure: Any, rows: Sequence[RenderMeasurement], which: Which) -> None:
    """Title, and below it the machine, threads and commit of the first row."""
    height = figure.get_figheight()
    what = "Error of the picture" if which == "image" else "Error of the gradients"
    figure.text(
        0.012, 1 - 0.12 / height, f"{what} against run time", fontsize=16, weight="bold", va="top"
    )
    if rows:
        row = rows[0]
        threads = f"{row.threads} thread{'s' * (row.threads > 1)}"
        figure.text(
            0.012,
            1 - 0.45 / height,
            f"{row.machine}\n{threads}, commit {row.commit}, {row.date[:10]}",
            fontsize=9.5,
            color="#444444",
            va="top",
        )


def _legend(figure: Any, handles: dict[str, Any], across: int) -> None:
    """One legend for all panels."""
    order = ("default", "front", *STYLES)
    ordered = [handles[name] for name in order if name in handles]
    if ordered:
        figure.legend(
            handles=ordered, loc="lower left", bbox_to_anchor=(0.008, 0.0), frameon=False,
            ncols=across, fontsize=9.5,
        )  # fmt: skip


def _name_points(axes: Any, marks: Sequence[_Mark]) -> None:
    """Write values beside points where there is room; the table has the others."""
    from matplotlib.patheffects import withStroke

    renderer = axes.figure._get_renderer()
    spots = [axes.transData.transform((m.seconds, m.error)).tolist() for m in marks]
    dots = [(x - 5, y - 5, x + 5, y + 5) for x, y in spots]
    window: Box = tuple(axes.get_window_extent(renderer).extents.tolist())
    taken: list[Box] = list(dots)
    for mark, (x, y) in zip(marks, spots):
        if mark.knob not in NAMED and mark.error > FLOOR:
            continue
        color = STYLES[mark.knob][0] if mark.knob in STYLES else "black"
        text = axes.annotate(
            mark.value, (mark.seconds, mark.error), xytext=(0, 0), textcoords="offset pixels",
            fontsize=8, color=color, ha="left", va="bottom", zorder=6,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
        _, _, width, height = text.get_window_extent(renderer).bounds
        width, height = float(width), float(height)  # not NumPy's
        place = _free(x, y, width, height, taken, window)
        if place is None:
            text.remove()
            continue
        left, bottom = place
        text.set_position((left - x, bottom - y))
        taken.append((left - 3, bottom, left + width + 3, bottom + height))


def _free(
    x: float, y: float, width: float, height: float, taken: Sequence[Box], window: Box
) -> tuple[float, float] | None:
    """Lower left corner of a label beside (x, y) that covers nothing; None: there is no room."""
    for gap, (side, rise) in product((7.0, 10.0, 14.0), _SIDES):
        left = x + side * gap + (side - 1) / 2 * width
        bottom = y + rise * gap + (rise - 1) / 2 * height
        box = (left, bottom, left + width, bottom + height)
        inside = (
            box[0] >= window[0]
            and box[1] >= window[1]
            and box[2] <= window[2]
            and box[3] <= window[3]
        )
        if inside and not any(overlap(box, other) for other in taken):
            return left, bottom
    return None


_SIDES = ((1, 1), (1, -1), (0, 1), (0, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0))


def overlap(a: Box, b: Box) -> bool:
    """Whether two boxes share an area."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
