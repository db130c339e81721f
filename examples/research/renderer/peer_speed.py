"""Speed of the renderer beside OpenSplat's CPU rasterizer, in the same run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from gsedit.bench.renderer.speed import Goal, Goals, Rival, Speed, measure_speed
from gsedit.bench.renderer.targets import table, target_of
from gsedit.errors import UsageError
from research.command import Points, print_result, run
from research.renderer.peers import PEER_TABLE, installed

PEER = "opensplat_cpu"
GOALS: Goals = {
    "garden 648x420": {"compiled": Goal(16, 8), "torch": Goal(4)},
    "garden 162x105": {"compiled": Goal(8), "torch": Goal(2.5)},
    "training step": {"compiled": Goal(5.4), "torch": Goal(2)},
    "crop": {"compiled": Goal(14), "torch": Goal(4)},
}
"""By case and kernel, against OpenSplat's rasterizer. The step and the crop were asked for in
milliseconds of one machine, as 2.6 and 1.4, and 4.7 and 2.1 times as fast as before."""


def measure_peer_speed(points: Path | None, runs: int, cache: Path | None) -> Iterator[Speed]:
    """Every case of `gsedit bench targets` against the peer. Raises UsageError where it is not
    installed.
    """
    if not any(peer.name == PEER for peer in installed()[0]):
        raise UsageError(
            f"{PEER} is not installed: docs/measurements/renderer.md says how it is built"
        )
    rival = Rival(PEER, PEER_TABLE[PEER].prepare, GOALS)
    yield from measure_speed(points, runs, cache, rival=rival)


def peer_speed(
    points: Points = None,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs; times are medians.")] = 7,
    cache: Annotated[Path, typer.Option(help="Folder that keeps the reference's pictures.")] = Path(
        "out/bench/references"
    ),
) -> None:
    """Print how many times as fast as OpenSplat's rasterizer both kernels are."""
    rows = [target_of(row) for row in measure_peer_speed(points, runs, cache)]
    print_result(table(rows))


if __name__ == "__main__":
    run(peer_speed)
