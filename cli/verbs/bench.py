"""`gsedit bench`: the speed and the errors of the renderer on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from ..core.command import VerbCommand, as_command, parameters_of
from ..core.console import print_result
from ..core.progress import progress

if TYPE_CHECKING:
    from gsedit.run.events import Event

bench = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)

Row = TypeVar("Row")
Points = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        envvar="GSEDIT_GARDEN",
        show_default=False,
        help="Points of the garden scene: garden.npz, a test asset of gsplat.",
    ),
]


@bench.callback()
def bench_() -> None:
    """Measure the renderer on this machine."""


def stability() -> None:
    """Draw extreme inputs one by one, and print the errors, or the message of a refusal.

    gsedit bench stability
    """
    from gsedit.bench.renderer.stability import measurements, table

    rows = collect(measurements())
    print_result({"rows": rows}, table(rows))


def targets(*, points: Points = None) -> None:
    """Print how many times as fast as the reference the renderer is here, and its errors.

    The exit code is 0 whether or not they are reached.

    gsedit bench targets --points garden.npz
    """
    from gsedit.bench.renderer.speed import measure_targets, table

    rows = collect(measure_targets(points))
    reached = sum(row.reached is True for row in rows)
    print_result({"targets": rows, "reached": reached}, table(rows))


for verb in (targets, stability):
    bench.command(cls=VerbCommand)(as_command(verb, parameters_of(verb), verb))


def collect(items: Iterator[Event | Row]) -> list[Row]:
    """The rows of a benchmark; its events are shown meanwhile."""
    from gsedit.run.events import Event

    rows: list[Row] = []
    with progress() as show:
        for item in items:
            if isinstance(item, Event):
                show(item)
            else:
                rows.append(item)
    return rows
