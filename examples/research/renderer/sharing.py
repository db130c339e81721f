"""Steps of a fit beside other programs: two fits at once, and a fit beside a busy loop."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import torch

from gsedit.datasets.dataset import Dataset
from gsedit.fitting.fit import fit_steps
from gsedit.fitting.settings import FitSettings
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians, traced_dataset
from rasterizer.numerics import AUTO, Kernel
from rasterizer.scene import Gaussians
from research.renderer.worker import Worker

LIBGOMP_SPINS = 300_000
"""Pauses that libgomp spins by itself."""


class FitSize(NamedTuple):
    """Size of the fit that is measured: it does not change while the fit runs."""

    gaussians: int = 40_000
    photos: int = 16
    side: int = 256
    """Side of a photo, pixels."""
    warm_up_steps: int = 3


FIT_SIZE = FitSize()


@dataclass(frozen=True)
class Sharing:
    """Steps of fits in a second, relative to one that has the machine for itself."""

    spinning: float
    """One alone, its threads waiting as libgomp's do by themselves."""
    two: float
    """Sum of two fits that run together."""
    busy: float
    """One beside a loop that keeps one processor."""


def measure_sharing(kernel: Kernel, runs: int, seconds: float) -> Sharing:
    """Medians over runs that take turns, each of so many seconds a case."""
    count = partial(count_steps, kernel)
    with (
        Worker() as first,
        Worker() as second,
        Worker(GOMP_SPINCOUNT=str(LIBGOMP_SPINS)) as spinner,
    ):
        for worker in (first, second, spinner):
            worker.call(count, 0.0)
        turns = [_turn(partial(count, seconds), first, second, spinner) for _ in range(runs)]
    return Sharing(*(statistics.median(column) for column in zip(*turns)))


def _turn(
    count: Callable[[], float], first: Worker, second: Worker, spinner: Worker
) -> tuple[float, float, float]:
    """The ratios of `Sharing`, once."""

    def rate(*workers: Worker) -> float:
        with ThreadPoolExecutor(len(workers)) as pool:
            calls = [pool.submit(each.call, count) for each in workers]
            return sum(call.result() for call in calls)

    alone = rate(first)
    spinning, two = rate(spinner), rate(first, second)
    with _busy_loop():
        busy = rate(first)
    return spinning / alone, two / alone, busy / alone


def count_steps(kernel: Kernel, seconds: float, size: FitSize = FIT_SIZE) -> float:
    """Steps in a second of a fit that begins, and knows of no other program; 0 seconds: none."""
    steps = _fit(kernel, size)
    began, count = time.perf_counter(), 0
    while (spent := time.perf_counter() - began) < seconds:
        next(steps)
        count += 1
    return count / max(spent, 1e-9)


def _fit(kernel: Kernel, size: FitSize) -> Iterator[Any]:
    """An event for each step of a fit that does not end, after its first steps."""
    settings = FitSettings(
        steps=10**9, seconds=None, coarse=(), densify_until=0.0, report_every=1, evaluations=1,
        checkpoint_seconds=1e9, execution=replace(AUTO, kernel=kernel),
    )  # fmt: skip
    photos, start = _inputs(size)
    generator = torch.Generator().manual_seed(0)
    steps = fit_steps(photos, settings, generator=generator, start=start)
    for _ in range(size.warm_up_steps):
        next(steps)
    return steps


@cache
def _inputs(size: FitSize) -> tuple[Dataset, Gaussians]:
    """The photos of a fit and the scene that it starts from."""
    scene = demo_scene()
    start = surface_gaussians(scene, size.gaussians, torch.Generator().manual_seed(0))
    return traced_dataset(scene, ring_cameras(scene, size.photos, size.side)), start


@contextmanager
def _busy_loop() -> Iterator[None]:
    """A process that keeps one processor."""
    loop = subprocess.Popen((sys.executable, "-c", "while True: pass"))
    try:
        yield
    finally:
        loop.kill()
        loop.wait()
