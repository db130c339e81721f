"""Error and loss against run time, as curves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.runs.events import Event
from gsedit.storage.atomic import atomic_path


def curves(
    events: Iterable[Event], field: Literal["error", "loss"] = "error"
) -> dict[str, list[tuple[float, float]]]:
    """(seconds, value) of every event that measured the field, by stage, in order."""
    measured: dict[str, list[tuple[float, float]]] = {}
    for event in events:
        value = getattr(event, field)
        if value is not None and math.isfinite(value):
            measured.setdefault(event.stage, []).append((event.seconds, value))
    return measured


def error_vs_time(events: Iterable[Event], path: Path | str, *, overwrite: bool = False) -> None:
    """A PNG of error and loss against run time, a curve a stage. Needs no screen."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    events = list(events)
    figure = Figure(figsize=(7, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    fields: tuple[Literal["error", "loss"], ...] = ("error", "loss")
    for axes, field in zip((upper, lower), fields):
        for stage, points in curves(events, field).items():
            axes.plot(*zip(*points), marker=".", label=stage)
        if axes.has_data():
            axes.legend()
        else:
            axes.text(0.5, 0.5, f"no {field} was measured", ha="center", transform=axes.transAxes)
        axes.grid(alpha=0.3)
    upper.set_ylabel("error (RMSE of colors in [0, 1])")
    lower.set_ylabel("loss")
    lower.set_xlabel("seconds since the start")
    lower.set_xlim(left=0)
    _add_decibels(upper)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _add_decibels(axes: Any) -> None:
    """Add a second scale in PSNR, where the curves have an error above zero."""
    high = axes.get_ylim()[1]
    if not axes.lines or high <= 0:
        return
    axes.set_ylim(0, high)
    ticks = [tick for tick in axes.get_yticks() if 1e-9 < tick <= high]  # 0 has no decibels
    right = axes.twinx()
    right.set_ylim(axes.get_ylim())
    right.set_yticks(ticks, [f"{psnr_from_rmse(tick):.1f}" for tick in ticks])
    right.set_ylabel("PSNR, dB")
