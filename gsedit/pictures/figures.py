"""Error and loss against run time, as curves and as a table of stages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Literal

from PIL import Image, ImageDraw, ImageFont

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.run.atomic import atomic_path
from gsedit.run.events import Event

WIDTH, PANEL, MARGIN = 770, 330, 54
"""Pixels: width of the figure, height of a panel, and what is left around its curves."""
NOTHING = 1e-9
"""Largest value that is drawn as 0."""
INK, GRID = "#333333", "#dddddd"
COLORS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b")
"""A color a stage, as matplotlib has them."""


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
    """A PNG of error and loss against run time, a curve a stage; errors in decibels on the right.

    It is drawn here: the import of matplotlib takes longer than the drawing.
    """
    events = list(events)
    figure = Image.new("RGB", (WIDTH, 2 * PANEL), "white")
    draw = ImageDraw.Draw(figure)
    end = max((event.seconds for event in events), default=0.0) or 1.0
    fields: tuple[Literal["error", "loss"], ...] = ("error", "loss")
    labels = {"error": "error (RMSE of colors in [0, 1]); right: PSNR, dB", "loss": "loss"}
    for row, field in enumerate(fields):
        _draw_panel(draw, row * PANEL, labels[field], curves(events, field), end, field == "error")
    draw.text((WIDTH / 2, 2 * PANEL - 6), "seconds since the start", INK, _font(), "mb")
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.save(temporary, format="PNG")


def _draw_panel(
    draw: ImageDraw.ImageDraw,
    top: int,
    label: str,
    measured: dict[str, list[tuple[float, float]]],
    end: float,
    with_decibels: bool,
) -> None:
    """One field's curves from `top` on, from 0 to `end` seconds."""
    high = max((value for points in measured.values() for _, value in points), default=0.0)
    high = high if high > NOTHING else 1.0
    left, right, low = MARGIN, WIDTH - MARGIN, top + PANEL - MARGIN
    across, up = (right - left) / (1.05 * end), (low - top - MARGIN) / (1.1 * high)
    draw.text((left, top + MARGIN - 8), label, INK, _font(), "lb")
    for tick in _ticks(end):
        x = left + tick * across
        draw.line((x, top + MARGIN, x, low), GRID, 1)
        draw.text((x, low + 6), f"{tick:g}", INK, _font(), "mt")
    for tick in _ticks(high):
        y = low - tick * up
        draw.line((left, y, right, y), GRID, 1)
        draw.text((left - 6, y), f"{tick:g}", INK, _font(), "rm")
        if with_decibels and measured and tick > 0:  # 0 has no decibels
            draw.text((right + 6, y), f"{psnr_from_rmse(tick):.1f}", INK, _font(), "lm")
    draw.rectangle((left, top + MARGIN, right, low), outline=INK)
    named = right
    for (stage, points), color in zip(measured.items(), cycle(COLORS)):
        draw.text((named, top + MARGIN - 8), stage, color, _font(), "rb")
        named -= draw.textlength(stage, _font()) + 14
        places = [(left + seconds * across, low - value * up) for seconds, value in points]
        draw.line(places, color, 2)
        for x, y in places:
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), color)
    if not measured:
        middle = ((left + right) / 2, (top + MARGIN + low) / 2)
        draw.text(middle, "nothing was measured", INK, _font(), "mm")


def _ticks(high: float) -> list[float]:
    """Round numbers from 0 to `high`, above 0, about five steps."""
    power = 10.0 ** math.floor(math.log10(high))
    step = next(power * part for part in (0.1, 0.2, 0.25, 0.5, 1, 2) if high <= 6 * power * part)
    return [k * step for k in range(int(high / step + 1e-9) + 1)]


def _font() -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(13)


def table(events: Iterable[Event]) -> str:
    """Time and gain of each stage as a plain text table, in the order in which they began; the
    seconds add up to the whole."""
    stages: dict[str, list[Event]] = {}
    seconds: dict[str, float] = {}
    before = 0.0
    for event in events:
        stages.setdefault(event.stage, []).append(event)
        seconds[event.stage] = seconds.get(event.stage, 0.0) + event.seconds - before
        before = event.seconds
    head = ("stage", "seconds", "steps", "loss", "error", "dB")
    rows = [head, *(_cells(stage, seconds[stage], parts) for stage, parts in stages.items())]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    return "\n".join(
        f"{row[0]:<{widths[0]}}  "
        + "  ".join(f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:]))
        for row in rows
    )


def _cells(stage: str, seconds: float, events: Sequence[Event]) -> tuple[str, ...]:
    """A row of the table, with the last loss and error that were measured."""
    loss, error = (
        next((value for e in reversed(events) if (value := getattr(e, name)) is not None), None)
        for name in ("loss", "error")
    )
    return (
        stage,
        f"{seconds:.1f}",
        str(events[-1].step or ""),
        "" if loss is None else f"{loss:.4f}",
        "" if error is None else f"{error:.4f}",
        "" if error is None else f"{psnr_from_rmse(error):.1f}",
    )
