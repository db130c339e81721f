"""Speed of the renderer as a ratio: how many times as fast as another renderer in the same run.

The other is OpenSplat's CPU rasteriser where its module is there (see peers.py), and else the
reference implementation in float32, which is torch and 20 to 400 times as slow. Both kernels and
the peer take turns, so that a busy machine slows all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, cast

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.measure import timed, timed_together
from gsedit.bench.renderer.accuracy import (
    FIELDS,
    Draw,
    Errors,
    differentiate,
    errors,
    reference_of,
)
from gsedit.bench.renderer.peers import PEER_TABLE, installed
from gsedit.bench.renderer.workloads import Workload, garden, smaller, synthetic
from gsedit.measures.photometric import photometric
from rasterizer import Camera, Execution, Gaussians, render
from rasterizer.blending.choose import is_compiled
from rasterizer.numerics import AUTO, Kernel
from rasterizer.project import Box
from rasterizer.reference import render_reference

GARDEN_SCALES = (1.0, 0.25)
PEER, REFERENCE = "opensplat_cpu", "reference"
TRAINED, SIDE, CROP = 61_000, 256, 64
"""Gaussians and pixels of the training step, and the side of its crop."""
DSSIM_WEIGHT = 0.2
"""As in a fit."""
REFERENCE_SECONDS = 10.0
"""No run of the reference begins after them."""


class Goal(NamedTuple):
    """How many times as fast, at least."""

    wall: float
    cpu: float | None = None


PEER_GOALS = {
    "garden 648x420": {"compiled": Goal(16, 8), "torch": Goal(4)},
    "garden 162x105": {"compiled": Goal(8), "torch": Goal(2.5)},
    "training step": {"compiled": Goal(5.4), "torch": Goal(2)},
    "crop": {"compiled": Goal(14), "torch": Goal(4)},
}
"""By case and kernel, against OpenSplat's rasteriser. The step and the crop were asked for in
milliseconds of one machine, as 2.6 and 1.4, and 4.7 and 2.1 times as fast as before."""
REFERENCE_GOALS = {
    "garden 648x420": {"compiled": Goal(150), "torch": Goal(18)},
    "garden 162x105": {"compiled": Goal(100), "torch": Goal(12)},
    "training step": {"compiled": Goal(120), "torch": Goal(16)},
    "crop": {"compiled": Goal(70), "torch": Goal(10)},
}
"""Against the reference implementation: half of what one thread of a processor with AVX-512
measured, because others have vectors half as wide."""


Loss = Callable[[Float[Tensor, "h w 3"]], Float[Tensor, ""]]


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, or a crop of one, and a loss of it: forward and backward are timed."""

    name: str
    workload: Workload
    loss: Loss
    box: Box | None = None
    """The crop."""

    def job(self, draw: Draw, camera: Camera) -> Callable[[], None]:
        """The work, done by a renderer and with that camera."""
        scene = self.workload.scene

        def run() -> None:
            leaves = scene.map(lambda t: t.detach().requires_grad_())
            inputs = [getattr(leaves, name) for name in FIELDS]
            torch.autograd.grad(self.loss(draw(leaves, camera)), inputs, allow_unused=True)

        return run

    def own_job(self, kernel: Kernel) -> Callable[[], None]:
        """The work, done by one of the rasteriser's kernels."""
        return self.job(self.drawing(kernel), self.workload.camera)

    def others_job(self, draw: Draw) -> Callable[[], None]:
        """The work, done by another renderer: a crop is a picture of its own."""
        camera = self.workload.camera
        return self.job(draw, camera if self.box is None else _cropped(camera, self.box))

    def drawing(self, kernel: Kernel) -> Draw:
        """The picture, or its crop, by one of the rasteriser's kernels."""
        execution = Execution(kernel=kernel)
        return lambda s, c: render(s, c, crop=self.box, execution=execution).color

    def errors(self, kernel: Kernel, cache: Path | None) -> Errors:
        """Of a kernel, against the reference."""
        scene, camera = self.workload.scene, self.workload.camera
        exact = reference_of(scene, camera, cache, self.box)
        return errors(differentiate(self.drawing(kernel), scene, camera), exact)


@dataclass(frozen=True)
class Speed:
    """One case drawn by one kernel, forward and backward."""

    case: str
    kernel: str
    other: str
    """PEER or REFERENCE."""
    seconds: float
    """Wall clock, median."""
    wall: float
    """How many times as fast as the other."""
    cpu: float
    goal: Goal | None
    error: float
    """Mean of a colour, against float64."""
    gradient: float | None
    """Of the worst input, relative."""

    @property
    def reached(self) -> bool:
        """Whether it is as fast as required."""
        goal = self.goal or Goal(0)
        return self.wall >= goal.wall and self.cpu >= (goal.cpu or 0)


def kernels() -> tuple[Kernel, ...]:
    """Those that there are on this machine."""
    return ("compiled", "torch") if is_compiled(AUTO) else ("torch",)


def measure_speed(
    points: Path | None, runs: int, cache: Path | None, shrink: int = 1
) -> Iterator[Speed]:
    """Every case by both kernels; those of the garden where its points are given."""
    for case in cases(points, shrink):
        yield from _measured(case, runs, cache)


def cases(points: Path | None, shrink: int = 1) -> list[Case]:
    """The garden at two sizes, a training step, a crop; of every `shrink`-th Gaussian and pixel."""
    found = []
    for scale in GARDEN_SCALES if points is not None else ():
        one = garden(scale, cast(Path, points))
        name = f"garden {one.camera.width}x{one.camera.height}"
        found.append(_case(name, one, shrink))
    (trained,) = synthetic(("columns",), TRAINED, SIDE)
    found.append(_case("training step", trained, shrink, photometric_loss))
    side, left = CROP // shrink, (SIDE - CROP) // 2 // shrink
    return [*found, _case("crop", trained, shrink, box=(left, left, side, side))]


def _case(
    name: str,
    workload: Workload,
    shrink: int,
    loss_of: Callable[[Float[Tensor, "h w 3"]], Loss] | None = None,
    box: Box | None = None,
) -> Case:
    workload = smaller(workload, shrink) if shrink > 1 else workload
    width, height = box[2:] if box else (workload.camera.width, workload.camera.height)
    pixels = torch.rand(height, width, 3, generator=torch.Generator().manual_seed(0))
    return Case(name, workload, (loss_of or weighted_sum)(pixels), box)


def weighted_sum(weights: Float[Tensor, "h w 3"]) -> Loss:
    """The picture's dot product with the weights: as good as no cost beside the renderer's."""
    return lambda picture: (picture * weights).sum()


def photometric_loss(photo: Float[Tensor, "h w 3"]) -> Loss:
    """That of a fit; the same for every renderer."""
    return lambda picture: photometric(picture, photo, DSSIM_WEIGHT, compiled=True)


def reference_drawing(scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
    """A picture by the reference implementation, in float32."""
    return render_reference(scene, camera, dtype=torch.float32).color


def _measured(case: Case, runs: int, cache: Path | None) -> Iterator[Speed]:
    works: dict[str, Callable[[], None]] = {kernel: case.own_job(kernel) for kernel in kernels()}
    other = PEER if any(peer.name == PEER for peer in installed()[0]) else REFERENCE
    if other == PEER:
        works[PEER] = case.others_job(PEER_TABLE[PEER].prepare(case.workload))
    timings, _ = timed_together(works, runs, pieces=1)
    if other == REFERENCE:
        slow = case.others_job(reference_drawing)
        timings[REFERENCE], _ = timed(slow, runs, REFERENCE_SECONDS, pieces=1)
    goals = (PEER_GOALS if other == PEER else REFERENCE_GOALS).get(case.name, {})
    theirs = timings[other]
    for kernel in kernels():
        ours, wrong = timings[kernel], case.errors(kernel, cache)
        yield Speed(
            case.name,
            kernel,
            other,
            ours.wall,
            theirs.wall / ours.wall,
            theirs.cpu / ours.cpu,
            goals.get(kernel),
            wrong.mean,
            wrong.gradient,
        )


def _cropped(camera: Camera, box: Box) -> Camera:
    """The crop of a camera's picture as a picture of its own."""
    left, top, width, height = box
    cx, cy = camera.cx - left, camera.cy - top
    return replace(camera, cx=cx, cy=cy, width=width, height=height)
