"""Speed of the renderer with its errors: how many times as fast as the reference in the same run.

The reference is torch in float32, 20 to 400 times as slow. Kernels take turns, so that a busy
machine slows all of them; a ratio holds on any maker's processor.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.renderer.accuracy import FIELDS, Draw, differentiate, errors, reference_of
from gsedit.bench.results import commit, machine, markdown_table
from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from gsedit.bench.synthetic.gallery import columns
from gsedit.capture.fitting.photometric import photometric
from gsedit.errors import InputError
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch
from rasterizer import Camera, Execution, Gaussians, render
from rasterizer.blending.choose import is_compiled
from rasterizer.numerics import AUTO, SH_DC, Kernel
from rasterizer.project import Box
from rasterizer.reference import render_reference


def garden(scale: float, path: Path) -> tuple[Gaussians, Camera]:
    """111,785 Gaussians and the first camera, of 648x420 pixels times `scale`.

    The points of mip-NeRF 360's garden (gsplat's test asset: means3d, colors, Ks, viewmats, width,
    height) inside [-2, 2]^3 keep their colors; scales, rotations and opacities are drawn, in this
    order, from NumPy's default_rng(0). Raises InputError where the file is not that.
    """
    try:
        with np.load(path) as file:
            data = {name: file[name] for name in file.files}
        inside = (np.abs(data["means3d"]) <= 2).all(1)
        means, colors = data["means3d"][inside], data["colors"][inside]
        k, pose = data["Ks"][0], torch.from_numpy(data["viewmats"][0]).double()
        width, height = int(data["width"]), int(data["height"])
    except (OSError, ValueError, KeyError, IndexError, EOFError) as error:
        raise InputError(
            f"{path}: not the garden's points ({error}); give gsplat's garden.npz, with means3d, "
            "colors, Ks, viewmats, width and height"
        ) from error
    count = len(means)
    rng = np.random.default_rng(0)
    scales = rng.random((count, 3)) * (0.02 - 1e-4) + 1e-4
    quats = rng.standard_normal((count, 4))
    opacities = rng.random(count)
    scene = Gaussians(
        means=torch.from_numpy(means),
        quats=torch.from_numpy(quats / np.linalg.norm(quats, axis=1, keepdims=True)),
        log_scales=torch.from_numpy(scales).log(),
        logit_opacities=torch.logit(torch.from_numpy(opacities)),
        sh=torch.from_numpy((colors / 255 - 0.5) / SH_DC)[:, None],
    )
    fx, fy, cx, cy = (float(k[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    camera = Camera(pose, fx, fy, cx, cy, width, height)
    return scene.to(torch.float32), camera.resized(round(width * scale), round(height * scale))


GARDEN_SCALES = (1.0, 0.25)
REFERENCE_SECONDS = 10.0
"""No run of the reference begins after them."""
RUNS = 7
GOALS: Mapping[str, Mapping[str, float]] = {
    "garden 648x420": {"compiled": 150.0, "torch": 18.0},
    "garden 162x105": {"compiled": 100.0, "torch": 12.0},
    "training step": {"compiled": 120.0, "torch": 16.0},
    "crop": {"compiled": 70.0, "torch": 10.0},
}
"""How many times as fast as the reference, at least, by case and kernel: half of what one thread of
a processor with AVX-512 measured, because others have vectors half as wide."""
Loss = Callable[[Float[Tensor, "h w 3"]], Float[Tensor, ""]]


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, or a crop of one, and a loss of it: forward and backward are timed."""

    name: str
    scene: Gaussians
    camera: Camera
    loss: Loss
    box: Box | None = None
    """Crop of the picture; None: all of it."""

    def job(self, draw: Draw, camera: Camera) -> Callable[[], None]:
        """The work, done by a renderer and with that camera."""

        def run() -> None:
            leaves = self.scene.map(lambda t: t.detach().requires_grad_())
            inputs = [getattr(leaves, name) for name in FIELDS]
            torch.autograd.grad(self.loss(draw(leaves, camera)), inputs, allow_unused=True)

        return run

    def reference_job(self) -> Callable[[], None]:
        """The work, done by the reference in float32: a crop is a picture of its own."""
        camera = self.camera
        if self.box is not None:
            left, top, width, height = self.box
            cx, cy = camera.cx - left, camera.cy - top
            camera = replace(camera, cx=cx, cy=cy, width=width, height=height)
        return self.job(lambda s, c: render_reference(s, c, dtype=torch.float32).color, camera)

    def drawing(self, kernel: Kernel) -> Draw:
        """The picture, or its crop, by one of the rasterizer's kernels."""
        execution = Execution(kernel=kernel)
        return lambda s, c: render(s, c, crop=self.box, execution=execution).color


@dataclass(frozen=True)
class Speed:
    """One case drawn by one kernel, forward and backward."""

    case: str
    kernel: str
    seconds: float
    """Median wall clock, seconds."""
    wall: float
    """How many times as fast as the reference."""
    cpu: float
    """The ratio of processor times."""
    goal: float | None
    """Least that `wall` should be; None: this machine's size of the case has no goal."""
    error: float
    """Mean error of a color, against float64."""
    gradient: float | None
    """Relative error of the worst input's gradient."""

    @property
    def reached(self) -> bool | None:
        """Whether it is as fast as required; None without a goal."""
        return None if self.goal is None else self.wall >= self.goal


def kernels() -> tuple[Kernel, ...]:
    """Those that there are on this machine."""
    return ("compiled", "torch") if is_compiled(AUTO) else ("torch",)


def measure_targets(
    points: Path | None, runs: int = RUNS, some: list[Case] | None = None
) -> Iterator[Event | Speed]:
    """Every case by both kernels, or some, and events that name the next ones; those of the garden
    where its points are given."""
    stopwatch = Stopwatch()
    if points is None:
        yield Event(
            "targets", 0.0, note="the garden's points are not given: its targets are left out"
        )
    found = some or cases(points)
    for step, case in enumerate(found):
        yield Event("targets", stopwatch.seconds, step, len(found), note=case.name)
        yield from measure_case(case, runs)
    yield Event("targets", stopwatch.seconds, len(found), len(found))


def cases(points: Path | None, count: int = 61_000, side: int = 256, crop: int = 64) -> list[Case]:
    """The garden at two sizes, a training step of `count` Gaussians, a crop; sides in pixels."""
    found = []
    for scale in GARDEN_SCALES if points is not None else ():
        scene, camera = garden(scale, cast("Path", points))
        size = (camera.width, camera.height)
        found.append(Case("garden {}x{}".format(*size), scene, camera, weighted_sum(*size)))
    scene = surface_gaussians(columns(), count, torch.Generator().manual_seed(0))
    camera = ring_cameras(columns(), 1, side)[0]
    photo = random_picture(side, side)
    loss = partial(photometric, target=photo, dssim_weight=0.2, compiled=True)
    left = (side - crop) // 2
    box, of_crop = (left, left, crop, crop), weighted_sum(crop, crop)
    found.append(Case("training step", scene, camera, loss))
    return [*found, Case("crop", scene, camera, of_crop, box)]


def random_picture(width: int, height: int) -> Float[Tensor, "h w 3"]:
    """Colors in [0, 1], the same at every call."""
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(0))


def weighted_sum(width: int, height: int) -> Loss:
    """The dot product with random weights: as good as no cost beside the renderer's."""
    weights = random_picture(width, height)
    return lambda picture: (picture * weights).sum()


def measure_case(case: Case, runs: int) -> Iterator[Speed]:
    """Both kernels against the reference implementation."""
    scene, camera = case.scene, case.camera
    jobs = {kernel: case.job(case.drawing(kernel), camera) for kernel in kernels()}
    ours = timed_together(jobs, runs)
    theirs = timed_together({"": case.reference_job()}, runs, REFERENCE_SECONDS)[""]
    exact = reference_of(scene, camera, case.box)
    for kernel in kernels():
        own = ours[kernel]
        wrong = errors(differentiate(case.drawing(kernel), scene, camera), exact)
        goal = GOALS.get(case.name, {}).get(kernel)
        yield Speed(
            case.name, kernel, own.wall, theirs.wall / own.wall, theirs.cpu / own.cpu, goal,
            wrong.mean, wrong.gradient,
        )  # fmt: skip


Name = TypeVar("Name", str, int)


@dataclass(frozen=True)
class Timing:
    """Medians of some runs, seconds."""

    wall: float
    cpu: float
    """Processor time of all threads together."""


def timed_together(
    works: Mapping[Name, Callable[[], None]], runs: int, budget: float = inf
) -> dict[Name, Timing]:
    """Medians after a warm-up of works that take turns.

    No run begins once `budget` seconds are spent. Where the warm-up alone spends them, it is the
    one run that counts: slow work is not run twice.
    """
    began = time.perf_counter()
    samples: dict[Name, list[tuple[float, float]]] = {name: [] for name in works}
    for turn in range(runs + 1):
        if turn and time.perf_counter() - began > budget:
            break
        for name, work in works.items():
            wall, cpu = time.perf_counter(), time.process_time()
            work()
            samples[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: _medians(taken) for name, taken in samples.items()}


def _medians(samples: list[tuple[float, float]]) -> Timing:
    counted = samples[1:] or samples
    wall, cpu = (statistics.median(column) for column in zip(*counted))
    return Timing(wall, cpu)


def table(rows: Sequence[Speed]) -> str:
    """Markdown: how many goals are reached on which machine, and a line a case and kernel."""
    words = {True: "yes", False: "**no**", None: "-"}
    lines = [
        (
            f"{row.case}, {row.kernel}", "-" if row.goal is None else f"{row.goal:g}",
            f"{row.wall:.1f}", f"{row.cpu:.1f}", f"{1e3 * row.seconds:.1f}", f"{row.error:.1e}",
            f"{row.gradient or 0:.1e}", words[row.reached],
        )
        for row in rows
    ]  # fmt: skip
    judged = [row for row in rows if row.reached is not None]
    reached = sum(row.reached is True for row in judged)
    threads = torch.get_num_threads()
    other_threads = "" if threads == 2 else " The goals are for 2 threads."
    head = (
        "forward and backward", "times as fast as the reference: goal", "measured", "by CPU time",
        "ms", "error of colors", "of gradients", "reached",
    )  # fmt: skip
    return (
        f"{reached} of {len(judged)} targets are reached on {machine()}, {threads} "
        f"thread{'s' * (threads > 1)}, commit {commit()}.{other_threads}\n\n"
        + markdown_table(head, lines)
    )
