"""Error and loss of stages against run time, as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.run.events import Event


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
