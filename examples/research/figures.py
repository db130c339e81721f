"""Plots of error against cost, a panel a problem and a line a method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import Any

from gsedit.run.atomic import atomic_path

Point = tuple[float, float]

Lines = Mapping[str, Sequence[Point]]
"""By the method's name: its points (cost, error), in the order in which they are joined."""
LOOKS = (
    ("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#E69F00", "v"),
    ("#56B4E9", "p"), ("#8C6D1F", "P"), ("#6A51A3", "X"), ("#555555", "<"), ("#000000", ">"),
)  # fmt: skip
"""Okabe and Ito's colors and some more, which color-blind readers tell apart by their markers."""
FLOOR = 1e-10
"""Smaller errors are drawn here: zero has no logarithm."""
PANEL = (3.6, 2.8)  # inches
ACROSS = 4
"""Most panels in a line."""


def draw_errors(
    panels: Mapping[str, Lines], path: Path, *, cost: str, error: str, logarithmic: bool = True
) -> None:
    """Write a PNG with a panel for each problem; `cost` and `error` are the titles of the axes."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    across = max(1, min(ACROSS, len(panels)))
    down = max(1, ceil(len(panels) / across))
    size = (PANEL[0] * across, PANEL[1] * down + 0.5)
    figure = Figure(figsize=size, dpi=120, layout="constrained")
    axes = figure.subplots(down, across, squeeze=False).flatten()
    names = list(dict.fromkeys(name for lines in panels.values() for name in lines))
    looks = {name: LOOKS[k % len(LOOKS)] for k, name in enumerate(names)}
    handles: dict[str, Any] = {}
    for panel, (title, lines) in zip(axes, panels.items()):
        panel.set(title=title, xlabel=cost, ylabel=error)
        panel.grid(which="major", color="#dddddd", linewidth=0.7)
        if logarithmic:
            panel.set(xscale="log", yscale="log")
        for name, points in lines.items():
            color, marker = looks[name]
            shown = [(x, max(y, FLOOR) if logarithmic else y) for x, y in points]
            style = {"color": color, "marker": marker, "markersize": 4.5, "linewidth": 1.2}
            (handles[name],) = panel.plot(*zip(*shown), **style)
    for panel in axes[len(panels) :]:
        panel.set_axis_off()
    if handles:
        legend = (list(handles.values()), list(handles))
        figure.legend(*legend, loc="outside lower center", ncols=min(len(handles), 5), fontsize=9)
    with atomic_path(path, overwrite=True) as temporary:
        figure.savefig(temporary, format="png")
