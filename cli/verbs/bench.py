"""`gsedit bench`: the speed and the errors of the renderer on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from ..core.command import VerbCommand, as_command, option, parameters_of
from ..core.console import print_message, print_result
from ..core.exits import Interrupted
from ..core.outputs import check_folder
from ..core.progress import progress
from ..options.common import Writes

if TYPE_CHECKING:
    from gsedit.run.events import Event

bench = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)

Row = TypeVar("Row")


@dataclass(frozen=True)
class StabilityOptions(Writes):
    """Options of `gsedit bench stability`."""

    out: Path = option(Path("out/stability"), "PATH", flags="--output -o")
    """Folder for the results."""
    quick: bool = option(False)
    """A short run: fewer and smaller cases."""


@dataclass(frozen=True)
class TargetOptions:
    """Options of `gsedit bench targets`."""

    points: Path | None = option(None, "FILE", envvar="GSEDIT_GARDEN")
    """Points of the garden scene: garden.npz, a test asset of gsplat."""


@bench.callback()
def bench_() -> None:
    """Measure the renderer on this machine."""


def stability(*, own: StabilityOptions) -> None:
    """Draw extreme inputs one by one, and print the errors, or the message of a refusal.

    Writes stability.jsonl and stability.md.

    gsedit bench stability -o out/stability
    """
    check_folder(own.out, own.force)

    from gsedit.bench.renderer.stability import ROWS_FILE, stability_to_folder, table

    items = stability_to_folder(own.out, quick=own.quick)
    rows = collect(items, own.out / ROWS_FILE)
    print_message(f"{len(rows)} cases are in {own.out}")
    print_result({"folder": own.out, "rows": rows}, table(rows))


def targets(*, own: TargetOptions) -> None:
    """Print how many times as fast as the reference the renderer is here, and its errors.

    The exit code is 0 whether or not they are reached.

    gsedit bench targets --points garden.npz
    """

    from gsedit.bench.renderer.speed import measure_targets, table

    rows = collect(measure_targets(own.points))
    reached = sum(row.reached is True for row in rows)
    print_result({"targets": rows, "reached": reached}, table(rows))


for verb in (targets, stability):
    bench.command(cls=VerbCommand)(as_command(verb, parameters_of(verb), verb))


def collect(items: Iterator[Event | Row], path: Path | None = None) -> list[Row]:
    """The rows of a benchmark; its events are shown meanwhile.

    `path`: where an interruption leaves the rows.
    """
    from gsedit.run.events import Event

    rows: list[Row] = []
    try:
        with progress() as show:
            for item in items:
                if isinstance(item, Event):
                    show(item)
                else:
                    rows.append(item)
    except KeyboardInterrupt:
        if path is None:
            raise
        remains = f"{len(rows)} rows are in {path}" if rows else "nothing was measured yet"
        raise Interrupted(f"interrupted; {remains}") from None
    return rows
