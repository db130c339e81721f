"""Progress on the terminal: bars, plain lines for a log, or JSON lines; a table of its stages."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from gsedit.measures.decibels import psnr_from_rmse
from gsedit.run.stopwatch import Stopwatch, duration

from .console import as_json, print_json, print_message, shown

if TYPE_CHECKING:
    from rich.progress import ProgressColumn

    from gsedit.run.events import Event

Show = Callable[["Event"], None]

NOTEBOOK = "JPY_PARENT_PID"
"""Variable of commands in a notebook: it shows a terminal's bars as a new line at every move."""


@contextmanager
def progress() -> Iterator[Show]:
    """Yield a function that shows events: as JSON lines, bars on a terminal, or plain lines."""
    if as_json.get():
        yield _print_as_json
    elif sys.stderr.isatty() and NOTEBOOK not in os.environ:
        with _bars() as show:
            yield show
    else:
        yield _plain_lines()


@contextmanager
def counting(stage: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows how many steps of a stage are done, and their number."""
    from gsedit.run.events import Event

    watch = Stopwatch()
    with progress() as show:
        yield lambda done, total: show(Event(stage, watch.seconds, done, total))


def result_of(items: Iterable[Any], handlers: Mapping[type, Callable[[Any], None]]) -> Any:
    """Hand each item to the function for its type; return the one without any, the last item."""
    result = None
    for item in items:
        if handle := handlers.get(type(item)):
            handle(item)
        else:
            result = item
    if result is None:
        raise RuntimeError("the work ended without a result")
    return result


def _print_as_json(event: Event) -> None:
    from gsedit.run.events import as_record

    print_json("event", as_record(event))


def summary(event: Event) -> str:
    """Return the measurements of an event: its loss, its error in dB, its note."""
    parts = []
    if event.loss is not None:
        parts.append(f"loss {event.loss:.4f}")
    if event.error is not None and " dB" not in event.note:  # a note may name the reference too
        parts.append(f"{psnr_from_rmse(event.error):.2f} dB")
    return "  ".join([*parts, *([event.note] if event.note else [])])


def _plain_lines() -> Show:
    """Return a function that prints a line where a stage begins, where it ends, and between."""
    first: dict[str, Event] = {}
    last_printed = 0.0

    def show(event: Event) -> None:
        nonlocal last_printed
        begins = event.stage not in first or event.step < first[event.stage].step
        if begins:
            first[event.stage] = event
        ends = 0 < event.steps <= event.step
        # a line in ten seconds: the log of an hour stays readable
        if begins or ends or event.seconds - last_printed >= 10.0:
            last_printed = event.seconds
            print_message(" ".join(plain_line(event, first[event.stage]).split()))

    return show


def plain_line(event: Event, first: Event) -> str:
    """Return an event as a line; `first` is the first event of its stage, for the time left."""
    count = f" {event.step}/{event.steps}" if event.steps else ""
    return f"[{event.seconds:.0f} s] {event.stage}{count} {summary(event)} {left(event, first)}"


def left(event: Event, first: Event) -> str:
    """Return the time to the end of a stage: what the event says, or by its pace since `first`."""
    seconds = event.left
    if seconds is None and event.step > first.step and event.steps > event.step:
        pace = (event.seconds - first.seconds) / (event.step - first.step)
        seconds = (event.steps - event.step) * pace
    return "" if seconds is None else f"about {duration(seconds)} left"


def stage_table(events: Iterable[Event]) -> str:
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


@contextmanager
def _bars() -> Iterator[Show]:
    """Yield a function that shows a progress bar for each stage."""
    from rich.console import Console
    from rich.progress import Progress, TaskID

    tasks: dict[str, TaskID] = {}
    first: dict[str, Event] = {}
    with Progress(*_columns(), console=Console(stderr=True)) as bars:

        def end_stages_without_steps() -> None:
            for task in bars.tasks:
                if task.total is None:
                    bars.update(task.id, total=1, completed=1)

        def show(event: Event) -> None:
            if event.stage not in tasks:
                end_stages_without_steps()
                tasks[event.stage] = bars.add_task(event.stage, total=None, left="", summary="")
            task = tasks[event.stage]
            if event.step < bars.tasks[task].completed:  # the stage starts again
                bars.reset(task)
                del first[event.stage]
            measured = shown(summary(event)) or bars.tasks[task].fields["summary"]
            total = event.steps or None
            time_left = left(event, first.setdefault(event.stage, event))
            bars.update(task, completed=event.step, total=total, left=time_left, summary=measured)

        yield show
        end_stages_without_steps()


def _columns() -> tuple[ProgressColumn, ...]:
    """Return the columns of a bar: stage, steps, times and the last measurement."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

    return (
        TextColumn("{task.description:<10}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.fields[summary]}", markup=False),
    )
