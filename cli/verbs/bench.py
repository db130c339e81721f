"""`gsedit bench`: the speed and the errors of the renderer on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from ..core.command import VerbCommand, as_command, flag
from ..core.console import print_message, print_result
from ..core.exits import Interrupted
from ..core.outputs import check_folder
from ..core.progress import progress
from ..options.common import Common, Force

if TYPE_CHECKING:
    from gsedit.runs.events import Event

bench = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)

Points = Annotated[
    Path | None,
    flag(
        "--points",
        "Points of the garden scene: garden.npz, a test asset of gsplat.",
        "FILE",
        envvar="GSEDIT_GARDEN",
    ),
]
Quick = Annotated[bool, flag("--quick", "A short run: fewer and smaller cases.")]
Folder = Annotated[Path, flag("--output -o", "Folder for the results.", "PATH")]

Row = TypeVar("Row")


@bench.callback()
def describe() -> None:
    """Measure the renderer on this machine."""


def stability(
    out: Folder = Path("out/stability"),
    quick: Quick = False,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Draw extreme inputs one by one, and print the errors, or the message of a refusal.

    Writes stability.jsonl and stability.md.

    gsedit bench stability -o out/stability
    """
    check_folder(out, force)
    common.apply()

    from gsedit.bench.renderer.stability import ROWS_FILE, stability_to_folder, table

    items = stability_to_folder(out, quick=quick)
    rows = collect(items, common, out / ROWS_FILE)
    print_message(f"{len(rows)} cases are in {out}")
    print_result({"folder": out, "rows": rows}, table(rows), as_json=common.json)


def targets(
    points: Points = None,
    quick: Quick = False,
    *,
    common: Common,
) -> None:
    """Print how many times as fast as the reference the renderer is here, and its errors.

    The exit code is 0 whether or not they are reached.

    gsedit bench targets --points garden.npz
    """
    common.apply()

    from gsedit.bench.renderer.speed import measure_targets, table

    rows = collect(measure_targets(points, quick=quick), common)
    reached = sum(row.reached is True for row in rows)
    print_result({"targets": rows, "reached": reached}, table(rows), as_json=common.json)


for verb in (targets, stability):
    bench.command(cls=VerbCommand)(as_command(verb))


def collect(items: Iterator[Event | Row], common: Common, path: Path | None = None) -> list[Row]:
    """The rows of a benchmark; its events are shown meanwhile.

    `path`: where an interruption leaves the rows.
    """
    from gsedit.runs.events import Event

    rows: list[Row] = []
    try:
        with progress(as_json=common.json) as show:
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
