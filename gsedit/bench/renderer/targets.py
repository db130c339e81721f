"""What the renderer promises, and what this machine says to it: name, goal, measured, reached.

Seconds are told in yardsticks (Y, see measure.py), medians of runs that take turns.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import isqrt
from pathlib import Path
from time import perf_counter

import torch

from gsedit.bench.curves import slope
from gsedit.bench.measure import (
    PAIRS,
    PIECES,
    QUICK_PIECES,
    Timing,
    commit,
    machine,
    timed,
    timed_together,
)
from gsedit.bench.renderer.accuracy import Drawn, differentiate, errors, truth_of
from gsedit.bench.renderer.pairs import listed_pairs, nearest_to_floor
from gsedit.bench.renderer.rows import markdown
from gsedit.bench.renderer.sweep import Setting, draw
from gsedit.bench.renderer.worker import Worker, WorkerError, peak_memory
from gsedit.bench.renderer.workloads import Workload, cloud, fitted, garden, smaller, synthetic
from gsedit.reports.events import Event
from rasterizer import render
from rasterizer.numerics import AUTO, DEFAULT, Execution
from rasterizer.project import Box
from rasterizer.tiles import TILE_SIZES

GOALS = {  # yardsticks: garden's scale, eager or compiled, forward or both
    (1.0, "eager"): (15.0, 40.0),
    (0.25, "eager"): (8.0, 15.0),
    (1.0, "compiled"): (8.0, 20.0),
    (0.25, "compiled"): (5.0, 10.0),
}
EXECUTIONS = {"eager": AUTO, "compiled": replace(AUTO, compile=True)}


@dataclass(frozen=True)
class Bar:
    """One promise."""

    name: str
    goal: str
    measured: str
    reached: bool | None
    """None: could not be measured here, for the reason in `measured`."""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    runs: int = 5
    pieces: int = PIECES
    shrink: int = 1
    """Of the scenes: every so many-th Gaussian and pixel."""
    clouds: tuple[int, ...] = (1_000, 4_000, 16_000, 64_000, 250_000, 1_000_000)
    """Gaussians; the last is drawn at 1920x1080, the others with as many pixels a Gaussian."""


FULL = Size()
QUICK = Size(runs=2, pieces=QUICK_PIECES, shrink=16, clouds=(1_000, 2_000, 4_000))


def measure_bars(
    size: Size, points: Path | None, scenes: Sequence[Path], cache: Path | None = None
) -> Iterator[Event | Bar]:
    """Every bar, with events that say what is going on. `points`: of the garden, else left out."""
    began = perf_counter()
    gardens = {} if points is None else {s: garden(s, points) for s in GARDEN_SCALES}
    workloads = [*gardens.values(), *(fitted(path) for path in scenes), *synthetic()]
    if size.shrink > 1:
        workloads = [smaller(one, size.shrink) for one in workloads]
        gardens = dict(zip(gardens, workloads))
    if points is None:
        yield Event("bars", 0.0, note="the garden's points are not given: its bars are left out")

    work: list[tuple[str, Callable[[], list[Bar]]]] = []
    for scale, one in gardens.items():
        work.append((f"times, {one.name}", partial(time_bars, one, scale, size)))
    for one in gardens.values():
        work.append((f"accuracy, {one.name}", partial(accuracy_bars, one, cache)))
    work += [(f"tile size, {one.name}", partial(tile_bars, one, size)) for one in workloads]
    if gardens:
        work.append(("crop", partial(crop_bars, gardens[1.0], size)))
        work.append(("threads", partial(thread_bars, gardens[1.0], size)))
    work.append(("memory and scaling", partial(scaling_bars, size)))
    for step, (what, job) in enumerate(work):
        yield Event("bars", perf_counter() - began, step, len(work), note=what)
        yield from job()
    yield Event("bars", perf_counter() - began, len(work), len(work))


GARDEN_SCALES = (1.0, 0.25)


def time_bars(workload: Workload, scale: float, size: Size) -> list[Bar]:
    """Eager and compiled, forward and both, against the goals in yardsticks."""
    found = []
    for name, execution in EXECUTIONS.items():
        drawing = partial(draw, Setting(execution=execution))
        both = partial(differentiate, drawing, workload.scene, workload.camera)
        for part, goal, job in zip(
            ("forward", "forward + backward"),
            GOALS[scale, name],
            (partial(_forward, drawing, workload), both),
        ):
            timing, _ = timed(job, size.runs, pieces=size.pieces)
            wall, cpu = timing.wall / timing.yardstick, timing.cpu / timing.yardstick
            measured = f"{wall:.1f} Y wall ({1e3 * timing.wall:.0f} ms), {cpu:.1f} Y CPU"
            label = f"{workload.name}, {name}, {part}"
            found.append(Bar(label, f"{goal:g} Y wall", measured, wall <= goal))
    return found


def _forward(drawing: Callable, workload: Workload) -> None:
    with torch.no_grad():
        drawing(workload.scene, workload.camera)


def accuracy_bars(workload: Workload, cache: Path | None) -> list[Bar]:
    """float32 against the reference, with and without the stop."""
    truth = truth_of(workload.scene, workload.camera, cache)
    whole = replace(DEFAULT, transmittance_min=0.0)
    drawings = {
        "no early stop": (partial(draw, Setting(numerics=whole)), 1e-6, 2e-5),
        "default stop": (partial(draw, Setting()), 5e-6, 1.2e-4),
    }
    found = []
    for name, (drawing, mean, tail) in drawings.items():
        drawn = differentiate(drawing, workload.scene, workload.camera)
        got = errors(drawn, truth)
        label = f"{workload.name}, float32, {name}"
        found += [
            Bar(f"{label}: mean error", f"{mean:.0e}", f"{got.mean:.1e}", got.mean <= mean),
            Bar(f"{label}: 99.9 %", f"{tail:.1e}", f"{got.tail:.1e}", got.tail <= tail),
            larger_errors_bar(label, workload, drawn, truth, tail),
            gradient_bar(label, drawn, truth),
        ]
    return found


def larger_errors_bar(
    label: str, workload: Workload, drawn: Drawn, truth: Drawn, limit: float
) -> Bar:
    """Each pixel with an error above the limit must have an alpha within rounding of the floor."""
    error = (drawn.picture.double() - truth.picture).abs().amax(-1)
    pixels = (error > limit).nonzero()
    nearest = nearest_to_floor(workload.scene, workload.camera, pixels)
    unexplained = int((nearest > ROUNDING).sum())
    measured = f"{unexplained} of {len(pixels)} such pixels, the largest error {error.max():.1e}"
    return Bar(f"{label}: errors above {limit:.1e} away from the floor", "0", measured,
               unexplained == 0)  # fmt: skip


ROUNDING = 1e-3
"""Of an alpha, relative: a place 500 pixels from the corner is rounded to 3e-5 pixels in float32,
and the exponent at the floor changes by up to sqrt(2 ln 255) / sqrt(0.3) = 6 a pixel, two
coordinates and the sums besides. By chance one pixel in thirty has such an alpha."""


def gradient_bar(label: str, drawn: Drawn, truth: Drawn) -> Bar:
    """Every input's gradient, the pose's too; names the worst."""
    by_input = {
        name: errors(replace(drawn, gradients={name: drawn.gradients[name]}), truth)
        for name in drawn.gradients
    }
    worst = max(by_input, key=lambda name: by_input[name].gradient or 0.0)
    error = by_input[worst].gradient or 0.0
    cosine = min(found.cosine for found in by_input.values() if found.cosine is not None)
    return Bar(
        f"{label}: gradients",
        "2e-04, cosine 0.999999",
        f"{error:.1e} ({worst}), cosine 1 - {1 - cosine:.0e}",
        error <= 2e-4 and cosine > 0.999999,
    )


def tile_bars(workload: Workload, size: Size) -> list[Bar]:
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
    return [Bar(f"{workload.name}: tile choice", "1.1 of the best", measured, ratio <= 1.1)]


def crop_bars(workload: Workload, size: Size) -> list[Bar]:
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
    return [Bar("four quarters as crops, forward", "1.5 of the whole", measured, ratio <= 1.5)]


def thread_bars(workload: Workload, size: Size) -> list[Bar]:
    """Forward and backward, on two threads against one."""
    name, goal = f"{workload.name}, 2 threads against 1", "1.7 times as fast"
    cores = os.cpu_count() or 1
    if cores < 2:
        return [Bar(name, goal, "this machine has one core", None)]
    before = torch.get_num_threads()

    def job(threads: int, execution: Execution) -> None:
        torch.set_num_threads(threads)
        drawing = partial(draw, Setting(execution=execution))
        differentiate(drawing, workload.scene, workload.camera)

    found = []
    for kind, execution in EXECUTIONS.items():
        try:
            jobs = {n: partial(job, n, execution) for n in (1, 2)}
            timings, _ = timed_together(jobs, size.runs, pieces=size.pieces)
        finally:
            torch.set_num_threads(before)
        ratio = timings[1].wall / timings[2].wall
        found.append(Bar(f"{name}, {kind}", goal, f"{ratio:.2f} times", ratio >= 1.7))
    return found


def scaling_bars(size: Size) -> list[Bar]:
    """Time and memory of clouds of ever more Gaussians; and the largest one's memory."""
    times, peaks = [], []
    peak: int | None = None
    timing: Timing | None = None
    note = ""
    drawing = partial(draw, Setting())
    with Worker() as worker:
        warm = cloud(100, 16, 16)
        for count in size.clouds:
            one = cloud(count, *pixels_for(count))
            pairs, _ = listed_pairs(one.scene, one.camera)
            job = partial(differentiate, drawing, one.scene, one.camera)
            timing, _ = timed(job, size.runs, budget=10.0, pieces=size.pieces)
            times.append((float(pairs), timing.wall))
            try:
                worker.call(differentiate, drawing, warm.scene, warm.camera)
                peak = worker.call(peak_memory, differentiate, drawing, one.scene, one.camera)
            except WorkerError as error:
                peak, note = None, str(error)
            if peak:
                peaks.append((float(pairs), float(peak)))
    pairs = f"{times[0][0]:.2g} to {times[-1][0]:.2g} pairs"
    name = f"{size.clouds[-1]:,} Gaussians at {'x'.join(map(str, pixels_for(size.clouds[-1])))}"
    assert timing
    seconds = f"{timing.wall:.1f} s, {timing.wall / timing.yardstick:.0f} Y"
    fitting = "a peak could not be measured" + (f": {note}" if note else "")
    return [
        Bar(f"{name}, forward + backward: memory above the inputs", "2.5 GB",
            fitting if peak is None else f"{peak / 1e9:.2f} GB ({seconds})",
            None if peak is None else peak < 2.5e9),
        slope_bar(f"time by pairs, forward + backward, {pairs}", times, ""),
        slope_bar(f"memory by pairs, forward + backward, {pairs}", peaks, fitting),
    ]  # fmt: skip


def pixels_for(count: int) -> tuple[int, int]:
    """Width and height of a 16:9 picture with as many pixels a Gaussian as a million in 1080p."""
    side = (count / 1e6) ** 0.5
    return max(16, round(1920 * side)), max(9, round(1080 * side))


def slope_bar(name: str, points: Sequence[tuple[float, float]], missing: str) -> Bar:
    """Linear: a doubling of pairs is no more than a doubling of cost, up to 5 % of the exponent.

    Fixed costs make the slope of the smallest pictures less; the steepest step is told too.
    """
    if len(points) < 2:
        return Bar(name, "log-log slope at most 1.05", missing or "too few sizes", None)
    found = slope(points)
    steepest = max(slope(pair) for pair in pairwise(points))
    measured = f"slope {found:.2f} (steepest step {steepest:.2f})"
    return Bar(name, "log-log slope at most 1.05", measured, found <= 1.05)


def table(bars: Sequence[Bar]) -> str:
    """Markdown: what was measured on what, and a line a bar."""
    words = {True: "yes", False: "**no**", None: "not measured"}
    lines = [(bar.name, bar.goal, bar.measured, words[bar.reached]) for bar in bars]
    asked = [bar for bar in bars if bar.reached is not None]
    reached = sum(bar.reached is True for bar in asked)
    threads = torch.get_num_threads()
    asked_of = "" if threads == 2 else " The goals are for 2 threads."
    return (
        f"{reached} of {len(asked)} bars are reached on {machine()}, {threads} "
        f"thread{'s' * (threads > 1)}, commit {commit()}. Y: the time of the arithmetic "
        f"of {PAIRS:,} pixel-Gaussian pairs on the same threads between the same runs."
        f"{asked_of}\n\n" + markdown(("bar", "goal", "measured", "reached"), lines)
    )
