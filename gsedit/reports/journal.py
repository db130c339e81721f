"""Error against run time: the records that long work yields, as JSON lines, tables and curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from itertools import groupby, pairwise
from pathlib import Path
from typing import IO, Any, Literal

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.reports.json_lines import read_lines, write_line
from rasterizer.scene import Gaussians


@dataclass(frozen=True)
class Event:
    """Something that happened in a long piece of work: one line of metrics.jsonl."""

    stage: str
    """What was being done: render, correspond, sample, update, measure, fit, ..."""
    seconds: float
    """Wall clock since the work began."""
    step: int = 0
    steps: int = 0
    """Position within the stage; 0 of 0 where it has no steps."""
    loss: float | None = None
    error: float | None = None
    """RMSE of colours in [0, 1] against what the stage aims at: held-out photos, edited targets."""
    note: str = ""
    """One human sentence, where there is something to say."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A complete scene in the middle of the work: worth keeping if the work is interrupted."""

    scene: Gaussians
    step: int
    seconds: float


def as_record(event: Event) -> dict[str, Any]:
    """The fields of an event that hold something, by name."""
    return {name: value for name, value in asdict(event).items() if value not in (None, "")}


def write_event(file: IO[str], event: Event) -> None:
    """Append an event as one JSON line; NaN and infinity are null."""
    write_line(file, as_record(event))


def read_events(path: Path | str) -> list[Event]:
    """The events of a metrics.jsonl. A last line without its newline was cut off: it is left out.

    Raises InputError naming the file and the line where a line is not an event.
    """
    names = ", ".join(field.name for field in fields(Event))
    advice = f"give the metrics.jsonl of an edit, whose lines are objects of {names}"
    return read_lines(path, Event, kind="an event", advice=advice)


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


@dataclass(frozen=True)
class Span:
    """A stretch of consecutive events of one stage."""

    stage: str
    seconds: float
    """Wall clock it took: from the end of the stretch before to its own last event."""
    step: int
    """Where it ended."""
    loss: float | None
    error: float | None
    """The last ones that were measured."""


def spans(events: Iterable[Event]) -> Iterator[Span]:
    """The work as a list of stages, in order; their seconds add up to the whole."""
    stretches = [list(stretch) for _, stretch in groupby(events, key=lambda event: event.stage)]
    ends = [0.0, *(stretch[-1].seconds for stretch in stretches)]
    for stretch, (start, end) in zip(stretches, pairwise(ends)):
        yield Span(
            stretch[-1].stage,
            end - start,
            stretch[-1].step,
            next((e.loss for e in reversed(stretch) if e.loss is not None), None),
            next((e.error for e in reversed(stretch) if e.error is not None), None),
        )


def table(events: Iterable[Event]) -> str:
    """Where the time went and what it bought: a plain text table, one row a stretch of work."""
    head = ("stage", "seconds", "steps", "loss", "error", "dB")
    rows = [head, *(_cells(span) for span in spans(events))]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    return "\n".join(
        f"{row[0]:<{widths[0]}}  "
        + "  ".join(f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:]))
        for row in rows
    )


def _cells(span: Span) -> tuple[str, ...]:
    return (
        span.stage,
        f"{span.seconds:.1f}",
        str(span.step) if span.step else "",
        "" if span.loss is None else f"{span.loss:.4f}",
        "" if span.error is None else f"{span.error:.4f}",
        "" if span.error is None else f"{psnr_from_rmse(span.error):.1f}",
    )
