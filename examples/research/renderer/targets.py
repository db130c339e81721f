"""Targets of the renderer that its engineers watch: `python -m research.renderer.targets`.

Beside those of `gsedit bench targets`: the choice of tiles, crops, and scaling with the number of
pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import isqrt
from pathlib import Path
from typing import Annotated

import torch
import typer

from gsedit.bench.renderer.accuracy import differentiate, draw_color
from gsedit.bench.renderer.speed import (
    GARDEN_SCALES,
    Speed,
    Workload,
    garden,
    kernels,
    measure_targets,
    smaller,
    synthetic,
)
from gsedit.bench.results import commit, machine, markdown_table
from gsedit.bench.timing import Timing, timed, timed_together
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer import render
from rasterizer.numerics import AUTO, Execution
from rasterizer.project import Box
from rasterizer.tiles import TILE_SIZES
from research.command import Points, Quick, collect, print_result, run
from research.curves import slope
from research.renderer.pairs import listed_pairs
from research.renderer.worker import Worker, WorkerError, peak_memory
from research.renderer.workloads import cloud, fitted

LARGEST = 1.5e9
"""Bytes above the inputs, of the largest cloud forward and backward."""


@dataclass(frozen=True)
class Target:
    """One target, and what this machine reaches."""

    name: str
    required: str
    measured: str
    reached: bool | None
    """None: it could not be measured here; `measured` holds the reason."""


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    runs: int = 7
    shrink: int = 1
    """Stride through the Gaussians and pixels of each scene."""
    clouds: tuple[int, ...] = (1_000, 4_000, 16_000, 64_000, 250_000, 1_000_000)
    """Gaussians; the last is drawn at 1920x1080, the others with as many pixels a Gaussian."""


WHOLE = Extent()
SHORT = Extent(2, 16, clouds=(1_000, 2_000, 4_000))


def measure_further(
    extent: Extent, points: Path | None, scenes: Sequence[Path]
) -> Iterator[Event | Target]:
    """Every target that `gsedit bench targets` lacks, and events that name the next ones."""
    stopwatch = Stopwatch()
    gardens = {} if points is None else {s: garden(s, points) for s in GARDEN_SCALES}
    workloads = [*gardens.values(), *(fitted(path) for path in scenes), *synthetic()]
    if extent.shrink > 1:
        workloads = [smaller(one, extent.shrink) for one in workloads]
        gardens = dict(zip(gardens, workloads))
    jobs = _jobs(gardens, workloads, extent)
    for step, (name, job) in enumerate(jobs):
        yield Event("targets", stopwatch.seconds, step, len(jobs), note=name)
        yield from job()
    yield Event("targets", stopwatch.seconds, len(jobs), len(jobs))


def _jobs(
    gardens: Mapping[float, Workload],
    workloads: Sequence[Workload],
    extent: Extent,
) -> list[tuple[str, Callable[[], list[Target]]]]:
    """List the measurements by name, in order."""
    runs = extent.runs
    jobs: list[tuple[str, Callable[[], list[Target]]]] = [
        (f"tile size, {one.name}", partial(tile_targets, one, runs)) for one in workloads
    ]
    if gardens:
        jobs.append(("crop", partial(crop_targets, gardens[1.0], runs)))
    jobs.append(("memory and scaling", partial(scaling_targets, extent)))
    return jobs


def executions() -> dict[str, Execution]:
    """By the name of each kernel that there is on this machine."""
    return {kernel: replace(AUTO, kernel=kernel) for kernel in kernels()}


def target_of(row: Speed) -> Target:
    """A measured speed as a target."""
    measured = (
        f"{row.wall:.1f}x, CPU {row.cpu:.1f}x ({1e3 * row.seconds:.1f} ms; errors: colors "
        f"{row.error:.1e}, gradients {row.gradient or 0:.1e})"
    )
    required = "-" if row.goal is None else f"{row.goal:g}x"
    name = f"{row.case}, {row.kernel}, times as fast as the reference"
    return Target(name, required, measured, row.reached)


def tile_targets(workload: Workload, runs: int) -> list[Target]:
    """Forward and backward with the chosen tile size, against the best of all sizes."""
    jobs = {}
    for side in TILE_SIZES:
        drawing = partial(draw_color, execution=replace(AUTO, tile_size=side))
        jobs[side] = partial(differentiate, drawing, workload.scene, workload.camera)
    timings, _ = timed_together(jobs, runs)
    best = min(TILE_SIZES, key=lambda side: timings[side].wall)
    pairs, pixels = listed_pairs(workload.scene, workload.camera)
    chosen = isqrt(pixels // max(1, pairs))
    ratio = timings[chosen].wall / timings[best].wall
    spread = ", ".join(f"{side}: {1e3 * timing.wall:.0f}" for side, timing in timings.items())
    measured = f"{chosen}: {ratio:.2f} of {best} (ms by side {spread})"
    return [Target(f"{workload.name}: tile choice", "1.1 of the best", measured, ratio <= 1.1)]


def crop_targets(workload: Workload, runs: int) -> list[Target]:
    """Four quarters of a picture, one after the other, against the whole of it."""
    camera = workload.camera
    width, height = camera.width // 2, camera.height // 2
    quarters = [(left, top, width, height) for left in (0, width) for top in (0, height)]

    def crops(boxes: Sequence[Box | None]) -> None:
        with torch.no_grad():
            for box in boxes:
                render(workload.scene, camera, crop=box)

    jobs = {"whole": partial(crops, [None]), "quarters": partial(crops, quarters)}
    timings, _ = timed_together(jobs, runs)
    ratio = timings["quarters"].wall / timings["whole"].wall
    measured = f"{ratio:.2f} of the whole"
    return [Target("four quarters as crops, forward", "1.5 of the whole", measured, ratio <= 1.5)]


@dataclass(frozen=True)
class CloudCost:
    """Forward and backward of one cloud."""

    pairs: int
    timing: Timing
    peak: int | None
    """Bytes above the inputs; None: not measured, for the reason in `note`."""
    note: str = ""


def scaling_targets(extent: Extent) -> list[Target]:
    """Time and memory of clouds of more and more Gaussians; and the largest one's memory."""
    targets = []
    for kernel, execution in executions().items():
        with Worker() as worker:
            costs = [_cloud_cost(n, extent.runs, worker, execution) for n in extent.clouds]
        last = costs[-1]
        pairs = f"{kernel}, forward + backward, {costs[0].pairs:.2g} to {last.pairs:.2g} pairs"
        picture = "x".join(map(str, pixels_for(extent.clouds[-1])))
        name = f"{extent.clouds[-1]:,} Gaussians at {picture}, {kernel}, forward + backward"
        reasons = [cost.note for cost in costs if cost.note]
        missing = ": ".join(("a peak could not be measured", *reasons[-1:]))
        times = [(float(cost.pairs), cost.timing.wall) for cost in costs]
        peaks = [(float(cost.pairs), float(cost.peak)) for cost in costs if cost.peak]
        measured = f"{(last.peak or 0) / 1e9:.2f} GB ({last.timing.wall:.1f} s)"
        targets += [
            Target(f"{name}: memory above the inputs", f"{LARGEST / 1e9:g} GB",
                   missing if last.peak is None else measured,
                   None if last.peak is None else last.peak < LARGEST),
            slope_target(f"time by pairs, {pairs}", times, ""),
            slope_target(f"memory by pairs, {pairs}", peaks, missing),
        ]  # fmt: skip
    return targets


def _cloud_cost(count: int, runs: int, worker: Worker, execution: Execution) -> CloudCost:
    drawing = partial(draw_color, execution=execution)
    warm, one = cloud(100, 16, 16), cloud(count, *pixels_for(count))
    pairs, _ = listed_pairs(one.scene, one.camera, execution=execution)
    job = partial(differentiate, drawing, one.scene, one.camera)
    timing, _ = timed(job, runs, budget=10.0)
    try:
        worker.call(differentiate, drawing, warm.scene, warm.camera)
        peak = worker.call(peak_memory, differentiate, drawing, one.scene, one.camera)
    except WorkerError as error:
        return CloudCost(pairs, timing, None, str(error))
    return CloudCost(pairs, timing, peak)


def pixels_for(count: int) -> tuple[int, int]:
    """Width and height of a 16:9 picture with as many pixels a Gaussian as a million in 1080p."""
    side = (count / 1e6) ** 0.5
    return max(16, round(1920 * side)), max(9, round(1080 * side))


def slope_target(name: str, points: Sequence[tuple[float, float]], missing: str) -> Target:
    """Linear cost: twice the pairs cost at most twice as much, up to 5 % of the exponent.

    Fixed costs make the slope of the smallest pictures less, so the steepest step is quoted too.
    `missing`: why there may be no points.
    """
    required = "log-log slope at most 1.05"
    if len(points) < 2:
        return Target(name, required, missing or "too few sizes", None)
    overall = slope(points)
    steepest = max(slope(pair) for pair in pairwise(points))
    measured = f"slope {overall:.2f} (steepest step {steepest:.2f})"
    return Target(name, required, measured, overall <= 1.05)


def table(targets: Sequence[Target]) -> str:
    """Markdown: how many are reached on which machine, and a line a target."""
    words = {True: "yes", False: "**no**", None: "not measured"}
    lines = [
        (target.name, target.required, target.measured, words[target.reached]) for target in targets
    ]
    measured = [target for target in targets if target.reached is not None]
    reached = sum(target.reached is True for target in measured)
    threads = torch.get_num_threads()
    other_threads = "" if threads == 2 else " The targets are for 2 threads."
    return (
        f"{reached} of {len(measured)} targets are reached on {machine()}, {threads} "
        f"thread{'s' * (threads > 1)}, commit {commit()}.{other_threads}\n\n"
        + markdown_table(("target", "required", "measured", "reached"), lines)
    )


def targets(
    scenes: Annotated[
        list[Path] | None, typer.Argument(metavar="SCENE", help="Fitted scenes to measure as well.")
    ] = None,
    points: Points = None,
    cache: Annotated[Path, typer.Option(help="Folder that keeps the reference's pictures.")] = Path(
        "out/bench/references"
    ),
    quick: Quick = False,
) -> None:
    """Print which targets the renderer reaches, those of `gsedit bench targets` first."""
    extent = SHORT if quick else WHOLE
    rows = [target_of(row) for row in collect(measure_targets(points, cache, quick=quick))]
    print_result(table([*rows, *collect(measure_further(extent, points, scenes or []))]))


if __name__ == "__main__":
    run(targets)
