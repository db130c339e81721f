"""What is told while work goes on (bars, plain lines or JSON), and what is kept meanwhile."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from gsedit.reports.journal import Checkpoint, Event

Tell = Callable[["Event"], None]

PATIENCE = 10.0  # seconds between plain lines of one stage: a log stays readable after an hour


class Interrupted(Exception):
    """Ctrl-C or `kill`, with what remains of the work."""


def say(text: str) -> None:
    """One line for a person, on stderr. Not through rich: it would fold a long line."""
    typer.echo(text, err=True)


def answer(record: dict[str, Any], text: str, *, as_json: bool) -> None:
    """The result of a verb, on stdout."""
    typer.echo(as_line("result", record) if as_json else text)


def as_line(kind: str, record: dict[str, Any]) -> str:
    return json.dumps(plain({"type": kind, **record}), allow_nan=False)


def plain(value: Any) -> Any:
    """Records, paths and tuples as what JSON has; numbers that it lacks (NaN, infinity) as null."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)


@contextmanager
def narrator(*, as_json: bool) -> Iterator[Tell]:
    """How events are told here: JSON lines on stdout, bars on a terminal, else plain lines."""
    if as_json:
        yield _tell_json
    elif sys.stderr.isatty():
        with _bars() as tell:
            yield tell
    else:
        yield _plain_lines()


def _tell_json(event: Event) -> None:
    from gsedit.reports.journal import as_record

    typer.echo(as_line("event", as_record(event)))


def summary(event: Event) -> str:
    """What an event measured: its loss, its error in dB, its note."""
    from gsedit.measures.decibels import psnr_from_rmse

    parts = []
    if event.loss is not None:
        parts.append(f"loss {event.loss:.4f}")
    if event.error is not None and " dB" not in event.note:  # a note may say it better
        parts.append(f"{psnr_from_rmse(event.error):.2f} dB")
    return "  ".join([*parts, *([event.note] if event.note else [])])


def _plain_lines() -> Tell:
    """A line where a stage begins, where it ends, and now and then between."""
    first: dict[str, Event] = {}
    told = 0.0

    def tell(event: Event) -> None:
        nonlocal told
        begins = event.stage not in first or event.step < first[event.stage].step
        if begins:
            first[event.stage] = event
        ends = 0 < event.steps <= event.step
        if begins or ends or event.seconds - told >= PATIENCE:
            told = event.seconds
            say(" ".join(plain_line(event, first[event.stage]).split()))

    return tell


def plain_line(event: Event, first: Event) -> str:
    """An event as a line; `first` is the event with which its stage began, for the time left."""
    count = f" {event.step}/{event.steps}" if event.steps else ""
    left = ""
    if event.step > first.step and event.steps > event.step:
        pace = (event.seconds - first.seconds) / (event.step - first.step)
        left = f"about {(event.steps - event.step) * pace:.0f} s left"
    return f"[{event.seconds:.0f} s] {event.stage}{count} {summary(event)} {left}"


@contextmanager
def _bars() -> Iterator[Tell]:
    """A progress bar a stage, on a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<10}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[summary]}", markup=False),
    )
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=Console(stderr=True)) as progress:

        def end_stages_without_steps() -> None:
            for task in progress.tasks:
                if task.total is None:
                    progress.update(task.id, total=1, completed=1)

        def tell(event: Event) -> None:
            if event.stage not in tasks:
                end_stages_without_steps()
                tasks[event.stage] = progress.add_task(event.stage, total=None, summary="")
            task = tasks[event.stage]
            if event.step < progress.tasks[task].completed:  # the stage has begun anew
                progress.reset(task)
            measured = summary(event) or progress.tasks[task].fields["summary"]
            total = event.steps or None
            progress.update(task, completed=event.step, total=total, summary=measured)

        yield tell
        end_stages_without_steps()


@dataclass
class Checkpoints:
    """The last complete scene of work in progress: kept if it ends early, removed when done."""

    path: Path
    advice: str
    """What to do with it, after "the last complete checkpoint is X (step N); "."""
    kept: Checkpoint | None = None

    def keep(self, checkpoint: Checkpoint) -> None:
        from gsedit.files import save

        self.path.parent.mkdir(parents=True, exist_ok=True)
        save(checkpoint.scene, self.path, overwrite=True)
        self.kept = checkpoint

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        if error is None:
            self.path.unlink(missing_ok=True)
        elif isinstance(error, KeyboardInterrupt):
            raise Interrupted(f"interrupted; {self.remains()}") from None
        elif self.kept:
            say(f"gsedit: {self.remains()}")

    def remains(self) -> str:
        if self.kept is None:
            if self.path.exists():
                return f"no new checkpoint was complete yet; the earlier one is {self.path}"
            return "no checkpoint was complete yet; add -f to start again"
        step = self.kept.step
        return f"the last complete checkpoint is {self.path} (step {step}); {self.advice}"


def follow(items: Iterable[Any], tell: Tell, checkpoints: Checkpoints) -> Any:
    """Tell the events and keep the checkpoints of a piece of work; its result, the last item."""
    from gsedit.reports.journal import Checkpoint, Event

    result = None
    for item in items:
        match item:
            case Event():
                tell(item)
            case Checkpoint():
                checkpoints.keep(item)
            case _:
                result = item
    if result is None:
        raise RuntimeError("the work ended without a result")
    return result
