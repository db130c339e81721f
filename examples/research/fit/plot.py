"""Held-out error against seconds: a row a capture, a column a measure, a line a recipe."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from research.figures import frame, save_png
from research.fit.moments import FitMeasurement

MEASURES = (("psnr", "PSNR, dB"), ("ssim", "SSIM"), ("perceptual", "perceptual distance"))
COLORS = ("#0072B2", "#D55E00", "#888888")  # Okabe and Ito's, which color-blind readers tell apart
PANEL = (3.6, 2.7)  # inches


def error_against_seconds(rows: Sequence[FitMeasurement], path: Path) -> None:
    """Write the plot as a PNG; overwrites. Needs no screen."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    names = list(dict.fromkeys(row.capture for row in rows))
    across, down = len(MEASURES), max(1, len(names))
    figure = Figure(figsize=(PANEL[0] * across, PANEL[1] * down + 0.4), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False)
    recipes = list(dict.fromkeys(row.recipe for row in rows))
    for line, name in zip(panels, names):
        for axes, (measure, label) in zip(line, MEASURES):
            _panel(axes, [row for row in rows if row.capture == name], recipes, measure)
            frame(axes, f"{name}: {label}", fontsize=9)
            axes.set_xlabel("seconds", fontsize=8)
            axes.tick_params(labelsize=8)
    handles = [panels[0][0].plot([], [], "o-", color=c)[0] for _, c in zip(recipes, COLORS)]
    figure.legend(handles, recipes, loc="outside lower center", ncols=len(recipes), fontsize=9)
    save_png(figure, path, overwrite=True)


def _panel(axes: Any, rows: Sequence[FitMeasurement], recipes: Sequence[str], measure: str) -> None:
    for recipe, color in zip(recipes, COLORS):
        points = [
            (row.seconds, value)
            for row in rows
            if row.recipe == recipe and (value := getattr(row, measure)) is not None
        ]
        if points:
            axes.plot(*zip(*points), "o-", color=color, markersize=3.5, linewidth=1.4)
    axes.set_xlim(left=0)
