"""Options, progress and errors that the experiments' commands share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.run.events import Event

Output = Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer and smaller cases.")]

Row = TypeVar("Row")

print_message = partial(typer.echo, err=True)
print_result = typer.echo


def run(command: Callable[..., None]) -> None:
    """Run a command with the process's arguments. Exits with one line and 2 or 3 on bad input, 1
    where something fails."""
    app = typer.Typer(add_completion=False)
    app.command()(command)
    try:
        app()
    except GseditError as error:
        print_message(f"error: {error}")
        sys.exit(2 if isinstance(error, UsageError) else 3 if isinstance(error, InputError) else 1)


def collect(items: Iterator[Event | Row]) -> list[Row]:
    """Collect the measurements of an experiment, and print its events to stderr meanwhile."""
    rows: list[Row] = []
    for item in items:
        if isinstance(item, Event):
            steps = f" {item.step}/{item.steps}" if item.steps else ""
            print_message(f"{item.seconds:8.1f} s  {item.stage}{steps}  {item.note or ''}".rstrip())
        else:
            rows.append(item)
    return rows


def require_new(folder: Path) -> None:
    """Raise UsageError where the folder has files: an experiment takes hours, keep its results."""
    if folder.is_dir() and any(folder.iterdir()):
        raise UsageError(f"{folder} is not empty: name another folder with -o")
