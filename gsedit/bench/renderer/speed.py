"""Speed of the renderer as a ratio: how many times as fast as another renderer in the same run.

The other is the reference implementation in float32, which is torch and 20 to 400 times as slow,
or a given rival. Both kernels and a rival take turns, so that a busy machine slows all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
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
from gsedit.errors import InputError
from gsedit.fitting.photometric import photometric
from gsedit.synthetic import ring_cameras, scenes, surface_gaussians
from rasterizer import Camera, Execution, Gaussians, render
from rasterizer.blending.choose import is_compiled
from rasterizer.numerics import AUTO, SH_DC, Kernel
from rasterizer.project import Box
from rasterizer.reference import render_reference

SYNTHETIC = ("columns", "cage")
"""Synthetic scenes that are measured: one hides most of itself, one has bars a few pixels wide."""


@dataclass(frozen=True, eq=False)
class Workload:
    """A scene and the camera that it is drawn from."""

    name: str
    scene: Gaussians
    camera: Camera


def garden(scale: float, path: Path, view: int = 0) -> Workload:
    """111,785 Gaussians and a camera of 648x420 pixels times `scale`; `view` is 0, 1 or 2.

    The points of mip-NeRF 360's garden (gsplat's test asset: means3d, colors, Ks, viewmats, width,
    height) inside [-2, 2]^3 keep their colors; scales, rotations and opacities are drawn, in this
    order, from NumPy's default_rng(0). Raises InputError where the file is not that.
    """
    try:
        with np.load(path) as file:
            data = {name: file[name] for name in file.files}
        inside = (np.abs(data["means3d"]) <= 2).all(1)
        means, colors = data["means3d"][inside], data["colors"][inside]
        k, pose = data["Ks"][view], torch.from_numpy(data["viewmats"][view]).double()
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
    camera = camera.resized(round(width * scale), round(height * scale))
    name = f"garden x{scale:g}" + (f", view {view}" if view else "")
    return Workload(name, scene.to(torch.float32), camera)


def synthetic(
    names: tuple[str, ...] = SYNTHETIC, count: int = 30_000, size: int = 256
) -> list[Workload]:
    """Discs on the surfaces of synthetic scenes."""
    chosen = [scene for scene in scenes() if scene.name in names]
    return [
        Workload(
            scene.name,
            surface_gaussians(scene, count, torch.Generator().manual_seed(0)),
            ring_cameras(scene, 1, size)[0],
        )
        for scene in chosen
    ]


def smaller(workload: Workload, factor: int) -> Workload:
    """Take every `factor`-th Gaussian and pixel of a workload, for a quick run."""
    camera = workload.camera
    return replace(
        workload,
        name=f"{workload.name}, 1 in {factor}",
        scene=workload.scene[::factor],
        camera=camera.resized(max(1, camera.width // factor), max(1, camera.height // factor)),
    )


GARDEN_SCALES = (1.0, 0.25)
REFERENCE = "reference"
DSSIM_WEIGHT = 0.2
"""Weight of DSSIM in the loss of a fit."""
REFERENCE_SECONDS = 10.0
"""No run of the reference begins after them."""


class TrainingStep(NamedTuple):
    """Size of the training step that is measured."""

    gaussians: int = 61_000
    side: int = 256
    """Side of the picture, pixels."""
    crop: int = 64
    """Side of its crop, pixels."""


TRAINING = TrainingStep()


class Goal(NamedTuple):
    """How many times as fast, at least."""

    wall: float
    cpu: float | None = None


REFERENCE_GOALS: Goals = {
    "garden 648x420": {"compiled": Goal(150), "torch": Goal(18)},
    "garden 162x105": {"compiled": Goal(100), "torch": Goal(12)},
    "training step": {"compiled": Goal(120), "torch": Goal(16)},
    "crop": {"compiled": Goal(70), "torch": Goal(10)},
}
"""Against the reference implementation: half of what one thread of a processor with AVX-512
measured, because others have vectors half as wide."""


Goals = Mapping[str, Mapping[str, Goal]]
"""By case and kernel."""
Loss = Callable[[Float[Tensor, "h w 3"]], Float[Tensor, ""]]


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, or a crop of one, and a loss of it: forward and backward are timed."""

    name: str
    workload: Workload
    loss: Loss
    box: Box | None = None
    """Crop of the picture; None: all of it."""

    def job(self, draw: Draw, camera: Camera) -> Callable[[], None]:
        """The work, done by a renderer and with that camera."""
        scene = self.workload.scene

        def run() -> None:
            leaves = scene.map(lambda t: t.detach().requires_grad_())
            inputs = [getattr(leaves, name) for name in FIELDS]
            torch.autograd.grad(self.loss(draw(leaves, camera)), inputs, allow_unused=True)

        return run

    def own_job(self, kernel: Kernel) -> Callable[[], None]:
        """The work, done by one of the rasterizer's kernels."""
        return self.job(self.drawing(kernel), self.workload.camera)

    def others_job(self, draw: Draw) -> Callable[[], None]:
        """The work, done by another renderer: a crop is a picture of its own."""
        camera = self.workload.camera
        return self.job(draw, camera if self.box is None else _cropped(camera, self.box))

    def drawing(self, kernel: Kernel) -> Draw:
        """The picture, or its crop, by one of the rasterizer's kernels."""
        execution = Execution(kernel=kernel)
        return lambda s, c: render(s, c, crop=self.box, execution=execution).color

    def errors(self, kernel: Kernel, cache: Path | None) -> Errors:
        """Measure the errors of a kernel against the reference."""
        scene, camera = self.workload.scene, self.workload.camera
        exact = reference_of(scene, camera, cache, self.box)
        return errors(differentiate(self.drawing(kernel), scene, camera), exact)


@dataclass(frozen=True)
class Speed:
    """One case drawn by one kernel, forward and backward."""

    case: str
    kernel: str
    other: str
    """REFERENCE, or the name of a rival."""
    seconds: float
    """Median wall clock, seconds."""
    wall: float
    """How many times as fast as the other."""
    cpu: float
    goal: Goal | None
    error: float
    """Mean of a color, against float64."""
    gradient: float | None
    """Relative error of the worst input's gradient."""

    @property
    def reached(self) -> bool:
        """Whether it is as fast as required."""
        goal = self.goal or Goal(0)
        return self.wall >= goal.wall and self.cpu >= (goal.cpu or 0)


@dataclass(frozen=True)
class Rival:
    """Another renderer to be compared with."""

    name: str
    prepare: Callable[[Workload], Draw]
    goals: Goals


def kernels() -> tuple[Kernel, ...]:
    """Those that there are on this machine."""
    return ("compiled", "torch") if is_compiled(AUTO) else ("torch",)


def measure_speed(
    points: Path | None,
    runs: int,
    cache: Path | None,
    shrink: int = 1,
    training: TrainingStep = TRAINING,
    rival: Rival | None = None,
) -> Iterator[Speed]:
    """Every case by both kernels; those of the garden where its points are given."""
    for case in cases(points, shrink, training):
        yield from measure_case(case, runs, cache, rival)


def cases(points: Path | None, shrink: int, training: TrainingStep) -> list[Case]:
    """The garden at two sizes, a training step, a crop; of every `shrink`-th Gaussian and pixel."""
    found = []
    for scale in GARDEN_SCALES if points is not None else ():
        one = garden(scale, cast("Path", points))
        name = f"garden {one.camera.width}x{one.camera.height}"
        found.append(_case(name, one, shrink))
    (trained,) = synthetic(("columns",), training.gaussians, training.side)
    found.append(_case("training step", trained, shrink, photometric_loss))
    side = training.crop // shrink
    left = (training.side - training.crop) // 2 // shrink
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


def measure_case(
    case: Case, runs: int, cache: Path | None, rival: Rival | None = None
) -> Iterator[Speed]:
    """Both kernels against the rival, or without one against the reference implementation."""
    works: dict[str, Callable[[], None]] = {kernel: case.own_job(kernel) for kernel in kernels()}
    other = rival.name if rival else REFERENCE
    if rival:
        works[other] = case.others_job(rival.prepare(case.workload))
    timings, _ = timed_together(works, runs, pieces=1)
    if not rival:
        slow = case.others_job(reference_drawing)
        timings[other], _ = timed(slow, runs, REFERENCE_SECONDS, pieces=1)
    goals = (rival.goals if rival else REFERENCE_GOALS).get(case.name, {})
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
