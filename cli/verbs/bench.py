"""`gsedit bench`: the speed and the errors of the renderer on this machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.command import option
from ..core.console import print_result
from ..core.progress import progress


@dataclass(frozen=True)
class BenchOptions:
    """Options of `gsedit bench`."""

    points: Path | None = option(None, "FILE", envvar="GSEDIT_GARDEN")
    """Points of the garden scene: garden.npz, a test asset of gsplat."""


def bench(*, own: BenchOptions) -> None:
    """Measure the speed and the errors of the renderer here.

    The exit code is 0 whether or not the targets are reached.

    gsedit bench --points garden.npz
    """
    from gsedit.bench.renderer.speed import measure_targets, table
    from gsedit.run.events import Event

    rows = []
    with progress() as show:
        for item in measure_targets(own.points):
            if isinstance(item, Event):
                show(item)
            else:
                rows.append(item)
    reached = sum(row.reached is True for row in rows)
    print_result({"targets": rows, "reached": reached}, table(rows))
