"""Performance targets of the renderer: what is required, measured, and whether it is reached.

Times are ratios of medians of runs that take turns, so that they hold on any maker's processor.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from math import isqrt
from pathlib import Path

import torch

from gsedit.bench.curves import slope
from gsedit.bench.markdown import markdown_table
from gsedit.bench.measure import PIECES, QUICK_PIECES, Timing, timed, timed_together, yardstick
from gsedit.bench.provenance import commit, machine
from gsedit.bench.renderer.accuracy import (
    Drawn,
    differentiate,
    errors,
    reference_of,
    with_pose,
)
from gsedit.bench.renderer.pairs import listed_pairs, nearest_to_floor
from gsedit.bench.renderer.settings import Setting, draw
from gsedit.bench.renderer.speed import GARDEN_SCALES, kernels, measure_speed
from gsedit.bench.renderer.worker import Worker, WorkerError, peak_memory
from gsedit.bench.renderer.workloads import Workload, cloud, fitted, garden, smaller, synthetic
from gsedit.reports.events import Event
from gsedit.reports.stopwatch import Stopwatch
from rasterizer import render
from rasterizer.numerics import AUTO, DEFAULT, Execution
from rasterizer.project import Box
from rasterizer.tiles import TILE_SIZES

LARGEST = 1.5e9
"""Bytes above the inputs, of the largest cloud forward and backward."""
SECOND_CORE = 0.8
"""Of what a second thread gains in the yardstick's arithmetic, which no list interrupts: processors
whose threads share a core gain less there too."""


@dataclass(frozen=True)
class Target:
    """One target, and what this machine reaches."""

    name: str
    required: str
    measured: str
    reached: bool | None
    """None: it could not be measured here; `measured` holds the reason."""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    runs: int = 7
    pieces: int = PIECES
    shrink: int = 1
    """Of the scenes: every so many-th Gaussian and pixel."""
    clouds: tuple[int, ...] = (1_000, 4_000, 16_000, 64_000, 250_000, 1_000_000)
    """Gaussians; the last is drawn at 1920x1080, the others with as many pixels a Gaussian."""


FULL = Size()
QUICK = Size(runs=2, pieces=QUICK_PIECES, shrink=16, clouds=(1_000, 2_000, 4_000))


def measure_targets(
    size: Size, points: Path | None, scenes: Sequence[Path], cache: Path | None = None
) -> Iterator[Event | Target]:
    """Every target, and events that name the next ones. `points`: of the garden, else left out."""
    stopwatch = Stopwatch()
    gardens = {} if points is None else {s: garden(s, points) for s in GARDEN_SCALES}
    workloads = [*gardens.values(), *(fitted(path) for path in scenes), *synthetic()]
    if size.shrink > 1:
        workloads = [smaller(one, size.shrink) for one in workloads]
        gardens = dict(zip(gardens, workloads))
    if points is None:
        yield Event(
            "targets", 0.0, note="the garden's points are not given: its targets are left out"
        )
    jobs = _jobs(points, gardens, workloads, size, cache)
    for step, (name, job) in enumerate(jobs):
        yield Event("targets", stopwatch.seconds, step, len(jobs), note=name)
        yield from job()
    yield Event("targets", stopwatch.seconds, len(jobs), len(jobs))


def _jobs(
    points: Path | None,
    gardens: Mapping[float, Workload],
    workloads: Sequence[Workload],
    size: Size,
    cache: Path | None,
) -> list[tuple[str, Callable[[], list[Target]]]]:
    """What is measured, by name, in order."""
    jobs: list[tuple[str, Callable[[], list[Target]]]] = [
        ("speed", partial(speed_targets, points, size, cache))
    ]
    jobs += [
        (f"accuracy, {one.name}", partial(accuracy_targets, one, cache)) for one in gardens.values()
    ]
    jobs += [(f"tile size, {one.name}", partial(tile_targets, one, size)) for one in workloads]
    if gardens:
        jobs.append(("crop", partial(crop_targets, gardens[1.0], size)))
        jobs.append(("threads", partial(thread_targets, gardens[1.0], size)))
    jobs.append(("memory and scaling", partial(scaling_targets, size)))
    return jobs


def executions() -> dict[str, Execution]:
    """By the name of each kernel that there is on this machine."""
    return {kernel: replace(AUTO, kernel=kernel) for kernel in kernels()}


def speed_targets(points: Path | None, size: Size, cache: Path | None) -> list[Target]:
    """Both kernels against another renderer, forward and backward."""
    targets = []
    for row in measure_speed(points, size.runs, cache, size.shrink):
        required = "-"
        if row.goal is not None:
            required = f"{row.goal.wall:g}x" + (f", CPU {row.goal.cpu:g}x" if row.goal.cpu else "")
        measured = (
            f"{row.wall:.1f}x, CPU {row.cpu:.1f}x ({1e3 * row.seconds:.1f} ms; errors: colours "
            f"{row.error:.1e}, gradients {row.gradient or 0:.1e})"
        )
        name = f"{row.case}, {row.kernel}, times as fast as {row.other}"
        targets.append(Target(name, required, measured, None if row.goal is None else row.reached))
    return targets


def accuracy_targets(workload: Workload, cache: Path | None) -> list[Target]:
    """float32 against the reference, with and without the early stop."""
    reference = reference_of(workload.scene, workload.camera, cache)
    whole = replace(DEFAULT, transmittance_min=0.0)
    limits = {"no early stop": (whole, 1e-6, 2e-5), "default stop": (DEFAULT, 5e-6, 1.2e-4)}
    targets = []
    for (name, (numerics, mean, tail)), kernel in product(limits.items(), kernels()):
        drawing = partial(draw, Setting(numerics=numerics, execution=replace(AUTO, kernel=kernel)))
        drawn = differentiate(drawing, workload.scene, workload.camera)
        drawn = with_pose(drawn, drawing, workload.scene, workload.camera)
        wrong = errors(drawn, reference)
        label = f"{workload.name}, {kernel}, {name}"
        targets += [
            Target(f"{label}: mean error", f"{mean:.0e}", f"{wrong.mean:.1e}", wrong.mean <= mean),
            Target(f"{label}: 99.9 %", f"{tail:.1e}", f"{wrong.tail:.1e}", wrong.tail <= tail),
            larger_errors_target(label, workload, drawn, reference, tail),
            gradient_target(label, drawn, reference),
        ]
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


ROUNDING = 1e-3
"""Of an alpha, relative: a place 500 pixels from the corner is rounded to 3e-5 pixels in float32,
and the exponent at the floor changes by up to sqrt(2 ln 255) / sqrt(0.3) = 6 a pixel, two
coordinates and the sums besides. By chance one pixel in thirty has such an alpha."""


def gradient_target(label: str, drawn: Drawn, reference: Drawn) -> Target:
    """Every input's gradient, the pose's too; names the worst."""
    by_input = {
        name: errors(replace(drawn, gradients={name: drawn.gradients[name]}), reference)
        for name in drawn.gradients
    }
    worst = max(by_input, key=lambda name: by_input[name].gradient or 0.0)
    error = by_input[worst].gradient or 0.0
    cosine = min(wrong.cosine for wrong in by_input.values() if wrong.cosine is not None)
    return Target(
        f"{label}: gradients",
        "2e-04, cosine 0.999999",
        f"{error:.1e} ({worst}), cosine 1 - {1 - cosine:.0e}",
        error <= 2e-4 and cosine > 0.999999,
    )


def tile_targets(workload: Workload, size: Size) -> list[Target]:
    """Forward and backward with the chosen tile size, against the best of all sizes."""
    jobs = {}
    for side in TILE_SIZES:
        drawing = partial(draw, Setting(execution=replace(AUTO, tile_size=side)))
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


def thread_targets(workload: Workload, size: Size) -> list[Target]:
    """Forward and backward, on two threads against one."""
    name = f"{workload.name}, 2 threads against 1"
    cores = os.cpu_count() or 1
    if cores < 2:
        return [Target(name, "-", "this machine has one core", None)]
    before = torch.get_num_threads()

    def job(threads: int, execution: Execution) -> None:
        torch.set_num_threads(threads)
        drawing = partial(draw, Setting(execution=execution))
        differentiate(drawing, workload.scene, workload.camera)

    def arithmetic(threads: int) -> None:
        torch.set_num_threads(threads)
        yardstick(size.pieces)

    targets = []
    for kind, execution in executions().items():
        jobs = {n: partial(job, n, execution) for n in (1, 2)}
        jobs |= {-n: partial(arithmetic, n) for n in (1, 2)}
        try:
            timings, _ = timed_together(jobs, size.runs, pieces=1)
        finally:
            torch.set_num_threads(before)
        ratio = timings[1].wall / timings[2].wall
        most = timings[-1].wall / timings[-2].wall
        targets.append(
            Target(
                f"{name}, {kind}",
                f"{SECOND_CORE:g} of what arithmetic gains",
                f"{ratio:.2f} times as fast; arithmetic {most:.2f} times",
                ratio >= SECOND_CORE * most,
            )
        )
    return targets


@dataclass(frozen=True)
class CloudCost:
    """Forward and backward of one cloud."""

    pairs: int
    timing: Timing
    peak: int | None
    """Bytes above the inputs; None: not measured, for the reason in `note`."""
    note: str = ""


def scaling_targets(size: Size) -> list[Target]:
    """Time and memory of clouds of more and more Gaussians; and the largest one's memory."""
    targets = []
    for kernel, execution in executions().items():
        with Worker() as worker:
            costs = [_cloud_cost(count, size, worker, execution) for count in size.clouds]
        last = costs[-1]
        pairs = f"{kernel}, forward + backward, {costs[0].pairs:.2g} to {last.pairs:.2g} pairs"
        picture = "x".join(map(str, pixels_for(size.clouds[-1])))
        name = f"{size.clouds[-1]:,} Gaussians at {picture}, {kernel}, forward + backward"
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
    drawing = partial(draw, Setting(execution=execution))
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
