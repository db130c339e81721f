"""Performance targets of the renderer: what is required, measured, and whether it is reached.

Times are ratios of medians of runs that take turns, so that they hold on any maker's processor.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import torch

from gsedit.bench.measure import PIECES, QUICK_PIECES, timed_together, yardstick
from gsedit.bench.provenance import commit, machine
from gsedit.bench.renderer.accuracy import (
    Drawn,
    differentiate,
    draw_color,
    errors,
    reference_of,
    with_pose,
)
from gsedit.bench.renderer.speed import (
    GARDEN_SCALES,
    TRAINING,
    Speed,
    TrainingStep,
    Workload,
    garden,
    kernels,
    measure_speed,
    smaller,
)
from gsedit.bench.results import markdown_table
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer.numerics import AUTO, DEFAULT, Execution

SECOND_CORE = 0.8
"""Share of the gain of a second thread in the yardstick's arithmetic, which no list interrupts:
processors whose threads share a core gain less there too."""

STOPS = {
    "no early stop": (replace(DEFAULT, transmittance_min=0.0), 1e-6, 2e-5),
    "default stop": (DEFAULT, 5e-6, 1.2e-4),
}
"""Numerics, and the most that a color's error may be: the mean, and at 99.9 % of the pixels."""


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
    """Stride through the Gaussians and pixels of each scene."""
    training: TrainingStep = TRAINING


FULL = Size()
QUICK = Size(runs=2, pieces=QUICK_PIECES, shrink=16)


def measure_targets(
    size: Size, points: Path | None, cache: Path | None = None
) -> Iterator[Event | Target]:
    """Every target, and events that name the next ones. `points`: of the garden, else left out."""
    stopwatch = Stopwatch()
    gardens = [] if points is None else [garden(scale, points) for scale in GARDEN_SCALES]
    if size.shrink > 1:
        gardens = [smaller(one, size.shrink) for one in gardens]
    if points is None:
        yield Event(
            "targets", 0.0, note="the garden's points are not given: its targets are left out"
        )
    jobs = [("speed", partial(speed_targets, points, size, cache))]
    jobs += [(f"accuracy, {one.name}", partial(accuracy_targets, one, cache)) for one in gardens]
    jobs += [("threads", partial(thread_targets, one, size)) for one in gardens[:1]]
    for step, (name, job) in enumerate(jobs):
        yield Event("targets", stopwatch.seconds, step, len(jobs), note=name)
        yield from job()
    yield Event("targets", stopwatch.seconds, len(jobs), len(jobs))


def executions() -> dict[str, Execution]:
    """By the name of each kernel that there is on this machine."""
    return {kernel: replace(AUTO, kernel=kernel) for kernel in kernels()}


def speed_targets(points: Path | None, size: Size, cache: Path | None) -> list[Target]:
    """Both kernels against another renderer, forward and backward."""
    rows = measure_speed(points, size.runs, cache, size.shrink, size.training)
    return [target_of(row) for row in rows]


def target_of(row: Speed) -> Target:
    """A measured speed as a target."""
    required = "-"
    if row.goal is not None:
        required = f"{row.goal.wall:g}x" + (f", CPU {row.goal.cpu:g}x" if row.goal.cpu else "")
    measured = (
        f"{row.wall:.1f}x, CPU {row.cpu:.1f}x ({1e3 * row.seconds:.1f} ms; errors: colors "
        f"{row.error:.1e}, gradients {row.gradient or 0:.1e})"
    )
    name = f"{row.case}, {row.kernel}, times as fast as {row.other}"
    return Target(name, required, measured, None if row.goal is None else row.reached)


def accuracy_targets(workload: Workload, cache: Path | None) -> list[Target]:
    """float32 against the reference, with and without the early stop."""
    reference = reference_of(workload.scene, workload.camera, cache)
    targets = []
    for (name, (numerics, mean, tail)), kernel in product(STOPS.items(), kernels()):
        drawing = partial(draw_color, numerics=numerics, execution=replace(AUTO, kernel=kernel))
        drawn = differentiate(drawing, workload.scene, workload.camera)
        drawn = with_pose(drawn, drawing, workload.scene, workload.camera)
        wrong = errors(drawn, reference)
        label = f"{workload.name}, {kernel}, {name}"
        targets += [
            Target(f"{label}: mean error", f"{mean:.0e}", f"{wrong.mean:.1e}", wrong.mean <= mean),
            Target(f"{label}: 99.9 %", f"{tail:.1e}", f"{wrong.tail:.1e}", wrong.tail <= tail),
            gradient_target(label, drawn, reference),
        ]
    return targets


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


def thread_targets(workload: Workload, size: Size) -> list[Target]:
    """Forward and backward, on two threads against one."""
    name = f"{workload.name}, 2 threads against 1"
    cores = os.cpu_count() or 1
    if cores < 2:
        return [Target(name, "-", "this machine has one core", None)]
    before = torch.get_num_threads()

    def job(threads: int, execution: Execution) -> None:
        torch.set_num_threads(threads)
        drawing = partial(draw_color, execution=execution)
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
