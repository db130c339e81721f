"""Targets of the renderer that its engineers watch: `python -m research.renderer.targets`.

Beside those of `gsedit bench targets`: errors away from the alpha floor, the choice of tiles,
crops, scaling with the number of pairs, and steps of a fit beside other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from math import isqrt
from pathlib import Path
from typing import Annotated

import torch
import typer

from gsedit.bench.measure import Timing, timed, timed_together
from gsedit.bench.renderer.accuracy import Drawn, differentiate, draw_color, reference_of
from gsedit.bench.renderer.speed import GARDEN_SCALES, Workload, garden, kernels, smaller, synthetic
from gsedit.bench.renderer.targets import (
    FULL,
    QUICK,
    STOPS,
    Size,
    Target,
    executions,
    measure_targets,
    table,
)
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer import render
from rasterizer.numerics import AUTO, Execution
from rasterizer.project import Box
from rasterizer.tiles import TILE_SIZES
from research.command import Points, Quick, collect, print_result, run
from research.curves import slope
from research.renderer.pairs import listed_pairs, nearest_to_floor
from research.renderer.sharing import measure_sharing
from research.renderer.worker import Worker, WorkerError, peak_memory
from research.renderer.workloads import cloud, fitted

LARGEST = 1.5e9
"""Bytes above the inputs, of the largest cloud forward and backward."""
ALONE, TWO_FITS, BUSY = 0.95, 0.85, 0.6
"""Steps of fits in a second: of one alone whose threads wait as libgomp's do by themselves; and of
one alone, by two at once and by one beside a busy loop."""
ROUNDING = 1e-3
"""Relative rounding of an alpha: a place 500 pixels from the corner is rounded to 3e-5 pixels in
float32, and the exponent at the floor changes by up to sqrt(2 ln 255) / sqrt(0.3) = 6 a pixel, two
coordinates and the sums besides. By chance one pixel in thirty has such an alpha."""


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    size: Size = FULL
    clouds: tuple[int, ...] = (1_000, 4_000, 16_000, 64_000, 250_000, 1_000_000)
    """Gaussians; the last is drawn at 1920x1080, the others with as many pixels a Gaussian."""
    fit_seconds: float = 8.0
    """How long steps of a fit are counted."""


WHOLE = Extent()
SHORT = Extent(QUICK, clouds=(1_000, 2_000, 4_000), fit_seconds=1.0)


def measure_further(
    extent: Extent, points: Path | None, scenes: Sequence[Path], cache: Path | None = None
) -> Iterator[Event | Target]:
    """Every target that `gsedit bench targets` lacks, and events that name the next ones."""
    stopwatch, size = Stopwatch(), extent.size
    gardens = {} if points is None else {s: garden(s, points) for s in GARDEN_SCALES}
    workloads = [*gardens.values(), *(fitted(path) for path in scenes), *synthetic()]
    if size.shrink > 1:
        workloads = [smaller(one, size.shrink) for one in workloads]
        gardens = dict(zip(gardens, workloads))
    jobs = _jobs(gardens, workloads, extent, cache)
    for step, (name, job) in enumerate(jobs):
        yield Event("targets", stopwatch.seconds, step, len(jobs), note=name)
        yield from job()
    yield Event("targets", stopwatch.seconds, len(jobs), len(jobs))


def _jobs(
    gardens: Mapping[float, Workload],
    workloads: Sequence[Workload],
    extent: Extent,
    cache: Path | None,
) -> list[tuple[str, Callable[[], list[Target]]]]:
    """List the measurements by name, in order."""
    size = extent.size
    jobs: list[tuple[str, Callable[[], list[Target]]]] = [
        (f"floor, {one.name}", partial(floor_targets, one, cache)) for one in gardens.values()
    ]
    jobs += [(f"tile size, {one.name}", partial(tile_targets, one, size)) for one in workloads]
    if gardens:
        jobs.append(("crop", partial(crop_targets, gardens[1.0], size)))
    jobs.append(("memory and scaling", partial(scaling_targets, extent)))
    jobs.append(("beside other programs", partial(sharing_targets, extent)))
    return jobs


def floor_targets(workload: Workload, cache: Path | None) -> list[Target]:
    """Errors of both kernels away from the floor, with and without the early stop."""
    reference = reference_of(workload.scene, workload.camera, cache)
    targets = []
    for (name, (numerics, _, tail)), kernel in product(STOPS.items(), kernels()):
        drawing = partial(draw_color, numerics=numerics, execution=replace(AUTO, kernel=kernel))
        drawn = differentiate(drawing, workload.scene, workload.camera)
        label = f"{workload.name}, {kernel}, {name}"
        targets.append(larger_errors_target(label, workload, drawn, reference, tail))
    return targets


def larger_errors_target(
    label: str, workload: Workload, drawn: Drawn, reference: Drawn, limit: float
) -> Target:
    """Each pixel with an error above the limit must have an alpha within rounding of the floor."""
    error = (drawn.picture.double() - reference.picture).abs().amax(-1)
    pixels = (error > limit).nonzero()
    nearest = nearest_to_floor(workload.scene, workload.camera, pixels)
    unexplained = int((nearest > ROUNDING).sum())
    measured = f"{unexplained} of {len(pixels)} such pixels, the largest error {error.max():.1e}"
    name = f"{label}: errors above {limit:.1e} away from the floor"
    return Target(name, "0", measured, unexplained == 0)


def tile_targets(workload: Workload, size: Size) -> list[Target]:
    """Forward and backward with the chosen tile size, against the best of all sizes."""
    jobs = {}
    for side in TILE_SIZES:
        drawing = partial(draw_color, execution=replace(AUTO, tile_size=side))
        jobs[side] = partial(differentiate, drawing, workload.scene, workload.camera)
    timings, _ = timed_together(jobs, size.runs, pieces=size.pieces)
    best = min(TILE_SIZES, key=lambda side: timings[side].wall)
    pairs, pixels = listed_pairs(workload.scene, workload.camera)
    chosen = isqrt(pixels // max(1, pairs))
    ratio = timings[chosen].wall / timings[best].wall
    spread = ", ".join(f"{side}: {1e3 * timing.wall:.0f}" for side, timing in timings.items())
    measured = f"{chosen}: {ratio:.2f} of {best} (ms by side {spread})"
    return [Target(f"{workload.name}: tile choice", "1.1 of the best", measured, ratio <= 1.1)]


def crop_targets(workload: Workload, size: Size) -> list[Target]:
    """Four quarters of a picture, one after the other, against the whole of it."""
    camera = workload.camera
    width, height = camera.width // 2, camera.height // 2
    quarters = [(left, top, width, height) for left in (0, width) for top in (0, height)]

    def crops(boxes: Sequence[Box | None]) -> None:
        with torch.no_grad():
            for box in boxes:
                render(workload.scene, camera, crop=box)

    jobs = {"whole": partial(crops, [None]), "quarters": partial(crops, quarters)}
    timings, _ = timed_together(jobs, size.runs, pieces=size.pieces)
    ratio = timings["quarters"].wall / timings["whole"].wall
    measured = f"{ratio:.2f} of the whole"
    return [Target("four quarters as crops, forward", "1.5 of the whole", measured, ratio <= 1.5)]


def sharing_targets(extent: Extent) -> list[Target]:
    """Steps of fits alone, two at once, and beside a busy loop."""
    targets = []
    for kernel, execution in executions().items():
        shared = measure_sharing(execution.kernel, extent.size.runs, extent.fit_seconds)
        rows = (
            ("fit alone, of one whose threads spin for long", ALONE, 1 / shared.spinning),
            ("two fits at once, of one alone", TWO_FITS, shared.two),
            ("fit beside a busy loop, of one alone", BUSY, shared.busy),
        )
        targets += [
            Target(f"{name}, {kernel}, steps", f"{least:g}", f"{ratio:.2f}", ratio >= least)
            for name, least, ratio in rows
        ]
    return targets


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
            costs = [_cloud_cost(n, extent.size, worker, execution) for n in extent.clouds]
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


def _cloud_cost(count: int, size: Size, worker: Worker, execution: Execution) -> CloudCost:
    drawing = partial(draw_color, execution=execution)
    warm, one = cloud(100, 16, 16), cloud(count, *pixels_for(count))
    pairs, _ = listed_pairs(one.scene, one.camera, execution=execution)
    job = partial(differentiate, drawing, one.scene, one.camera)
    timing, _ = timed(job, size.runs, budget=10.0, pieces=size.pieces)
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
    rows = collect(measure_targets(extent.size, points, cache))
    print_result(table([*rows, *collect(measure_further(extent, points, scenes or [], cache))]))


if __name__ == "__main__":
    run(targets)
