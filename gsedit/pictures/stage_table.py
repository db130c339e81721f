"""Time of long work by stage, as a plain text table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.runs.events import Event


@dataclass(frozen=True)
class Span:
    """A stretch of consecutive events of one stage."""

    stage: str
    seconds: float
    """Wall clock it took: from the end of the stretch before to its own last event."""
    step: int
    """Step at which it ended."""
    loss: float | None
    error: float | None
    """The last ones that were measured."""


def spans(events: Iterable[Event]) -> Iterator[Span]:
    """The work as a list of stages, in order; their seconds add up to the whole."""
    stretches = [list(stretch) for _, stretch in groupby(events, key=lambda event: event.stage)]
    ends = [0.0, *(stretch[-1].seconds for stretch in stretches)]
    for stretch, (start, end) in zip(stretches, pairwise(ends)):
        yield _span(stretch, end - start)


def _span(parts: Sequence[Event | Span], seconds: float) -> Span:
    """All of a stage's events, or of its stretches, as one stretch."""
    loss, error = (
        next((value for e in reversed(parts) if (value := getattr(e, name)) is not None), None)
        for name in ("loss", "error")
    )
    return Span(parts[-1].stage, seconds, parts[-1].step, loss, error)


MOST_ROWS = 60
"""Stretches; of more than these, the table has a row a stage."""


def by_stage(stretches: Iterable[Span]) -> Iterator[Span]:
    """The stretches of each stage as one, in the order in which the stages began."""
    stages: dict[str, list[Span]] = {}
    for span in stretches:
        stages.setdefault(span.stage, []).append(span)
    for parts in stages.values():
        yield _span(parts, sum(part.seconds for part in parts))


def table(events: Iterable[Event]) -> str:
    """Time and gain of each stretch of work as a plain text table, or of each stage where there are
    many stretches."""
    head = ("stage", "seconds", "steps", "loss", "error", "dB")
    stretches = list(spans(events))
    stretches = list(by_stage(stretches)) if len(stretches) > MOST_ROWS else stretches
    rows = [head, *(_cells(span) for span in stretches)]
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
