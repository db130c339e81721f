"""Gaussians from posed photos: coarse to fine, densified where the pictures disagree most.

The recipe is Kerbl et al. 2023 (3D Gaussian Splatting), shortened to the few thousand steps a CPU
can take.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import log10

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.measures import losses
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.reports.events import Checkpoint, Event
from gsedit.views.dataset import Dataset, View
from gsedit.views.pictures import downscale
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, SH_DC, Execution
from rasterizer.project import rotation_matrices
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate


@dataclass(frozen=True)
class FitSettings:
    """How long, how fine, how fast. Fractions are of the budget, whichever runs out first."""

    steps: int | None = None
    """Optimiser steps; None: as many as the time allows."""
    seconds: float | None = 600.0
    """Wall clock; None: until the steps are done."""
    sh_degree: int = 1
    """View dependence; higher degrees cost time and memorise exposure."""
    coarse: tuple[tuple[float, int], ...] = ((0.08, 4), (0.3, 2))
    """Until this fraction of the budget, train on pictures this many times smaller."""
    dssim_weight: float = 0.2
    max_gaussians: int = 120_000
    densify_every: int = 100
    densify_until: float = 0.6
    """Fraction of the budget after which the number of Gaussians is left alone."""
    densify_fraction: float = 0.05
    """Share of the Gaussians, of largest positional gradient, that divide each time."""
    prune_opacity: float = 0.005
    opacity_reset: float | None = 0.3
    """Fraction of the budget at which opacities are lowered once, so that floaters die."""
    report_every: int = 10
    evaluations: int = 10
    """Times that the held-out views are measured."""
    checkpoint_seconds: float = 30.0
    execution: Execution = AUTO
    """How pictures are drawn: `Execution(compile=True)` draws the same ones sooner."""

    def __post_init__(self) -> None:
        if self.steps is None and self.seconds is None:
            raise UsageError("fit needs a budget: give --steps, --minutes or both")
        for name in ("steps", "seconds"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise UsageError(f"the budget in {name} is {value}: give a number above 0")
        if not 0 <= self.sh_degree <= 3:
            raise UsageError(f"SH degree {self.sh_degree} is not in 0 to 3, what .ply files hold")


@dataclass(frozen=True, eq=False)
class FitResult:
    scene: Gaussians
    psnr: float
    """On the held-out views, dB."""
    steps: int
    seconds: float
    curve: tuple[tuple[float, float], ...]
    """(seconds, held-out dB) at every evaluation."""


# Learning rates of 3D Gaussian splatting; positions are in units of the scene's radius. Colours,
# opacities and
# scales move faster than there, as a fit here has 3,000 steps and not 30,000.
RATES = {
    "means": 3.2e-4,
    "quats": 2e-3,
    "log_scales": 1e-2,
    "logit_opacities": 5e-2,
    "sh": 1e-2,
}
FINAL_RATE = {"means": 0.02, "sh": 0.2, "log_scales": 0.3, "logit_opacities": 0.3, "quats": 0.3}
"""Each rate decays exponentially to this fraction at the end of the budget."""
RESET_OPACITY = 0.1


def fit_steps(
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    *,
    generator: torch.Generator,
    start: Gaussians | None = None,
) -> Iterator[Event | Checkpoint | FitResult]:
    """Fit a scene; yields progress, complete scenes now and then, and last the result.

    Every 8th view is never trained on. Raises UsageError if there is nothing to train on.
    """
    train, held_out = dataset.split()
    if not train:
        raise UsageError(
            f"{len(dataset)} view(s) are too few to fit: every 8th is held out; add photos"
        )
    clock = _Clock(settings)
    radius = _scene_radius(dataset.views)
    scene = start if start is not None else initial_scene(dataset, settings.sh_degree, generator)
    optimiser = SceneOptimiser(scene, {**RATES, "means": RATES["means"] * radius})
    pyramid = {
        f: tuple(_shrunk(v, f) for v in train) for f in (1, *(f for _, f in settings.coarse))
    }
    tracker = _Gradients(len(scene))
    curve: list[tuple[float, float]] = []
    due, saved, reset_done = 0.0, 0.0, settings.opacity_reset is None
    order: list[int] = []
    running = None

    while not clock.finished:
        factor = next((f for until, f in settings.coarse if clock.progress < until), 1)
        if not order:
            order = torch.randperm(len(train), generator=generator).tolist()
        view = pyramid[factor][order.pop()]
        scene = optimiser.scene
        # photos are opaque: before a random colour, every hole in the scene costs
        background = torch.rand(3, generator=generator)
        picture = render(
            scene, view.camera, background=background, execution=settings.execution
        ).color
        loss = (1 - settings.dssim_weight) * losses.l1(picture, view.image)
        if settings.dssim_weight:
            loss = loss + settings.dssim_weight * losses.dssim(picture, view.image)
        loss.backward()
        tracker.add(optimiser.gradient("means"), scene, view.camera)
        optimiser.step({k: v**clock.progress for k, v in FINAL_RATE.items()})
        clock.step += 1
        running = loss.item() if running is None else 0.95 * running + 0.05 * loss.item()

        if clock.step % settings.densify_every == 0 and clock.progress < settings.densify_until:
            scene, origin, fresh = densify(
                optimiser.scene.detach(), tracker.mean, settings, generator
            )
            optimiser.replace(scene, origin, fresh)
            tracker = _Gradients(len(scene))
        if not reset_done and clock.progress >= (settings.opacity_reset or 0):
            reset_done = True
            scene = _lower_opacity(optimiser.scene.detach())
            everyone = torch.arange(len(scene))
            optimiser.replace(scene, everyone, torch.zeros(len(scene), dtype=torch.bool))
        if clock.progress >= due and not clock.finished:
            due += 1 / settings.evaluations
            psnr = evaluate(optimiser.scene.detach(), held_out, settings.execution)
            curve.append((clock.seconds, psnr))
            yield _event(
                "measure", clock, running, psnr, f"{len(scene):,} Gaussians, {psnr:.2f} dB"
            )
        elif clock.step % settings.report_every == 0:
            yield _event("fit", clock, running, None, f"{len(scene):,} Gaussians")
        if clock.seconds - saved > settings.checkpoint_seconds:
            saved = clock.seconds
            yield Checkpoint(optimiser.scene.detach(), clock.step, clock.seconds)

    scene = optimiser.scene.detach().map(torch.clone)
    psnr = evaluate(scene, held_out, settings.execution)
    curve.append((clock.seconds, psnr))
    yield _event("measure", clock, running, psnr, f"{len(scene):,} Gaussians, {psnr:.2f} dB")
    yield FitResult(scene, psnr, clock.step, clock.seconds, tuple(curve))


def fit(
    dataset: Dataset,
    settings: FitSettings = FitSettings(),
    *,
    generator: torch.Generator | None = None,
    start: Gaussians | None = None,
) -> FitResult:
    """`fit_steps` to the end."""
    generator = generator or torch.Generator().manual_seed(0)
    *_, last = fit_steps(dataset, settings, generator=generator, start=start)
    assert isinstance(last, FitResult)
    return last


class _Clock:
    """Steps and seconds, and how much of the budget they are."""

    def __init__(self, settings: FitSettings) -> None:
        self.settings, self.step, self.began = settings, 0, time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.began

    @property
    def progress(self) -> float:
        steps, seconds = self.settings.steps, self.settings.seconds
        by_step = 0.0 if steps is None else self.step / steps
        by_time = 0.0 if seconds is None else self.seconds / seconds
        return max(by_step, by_time)

    @property
    def finished(self) -> bool:
        return self.progress >= 1

    @property
    def steps(self) -> int:
        """Expected number of steps in the whole budget."""
        return max(self.step, round(self.step / max(self.progress, 1e-9)))


def _event(stage: str, clock: _Clock, loss: float | None, psnr: float | None, note: str) -> Event:
    error = None if psnr is None else rmse_from_psnr(psnr)
    return Event(stage, clock.seconds, clock.step, clock.steps, loss, error, note)


@torch.no_grad()
def evaluate(scene: Gaussians, views: tuple[View, ...], execution: Execution = AUTO) -> float:
    """Mean PSNR over views, dB."""
    pictures = (render(scene, v.camera, execution=execution).color.clamp(0, 1) for v in views)
    errors = [losses.mse(picture, v.image).item() for picture, v in zip(pictures, views)]
    return sum(-10 * log10(max(e, 1e-12)) for e in errors) / len(errors)


def _shrunk(view: View, factor: int) -> View:
    """The picture area-averaged to a grid `factor` times coarser."""
    if factor == 1:
        return view
    camera = view.camera
    small = camera.resized(max(16, camera.width // factor), max(16, camera.height // factor))
    return replace(view, camera=small, image=downscale(view.image, small.width, small.height))


def _scene_radius(views: tuple[View, ...]) -> float:
    """Largest distance of a camera from the cameras' middle: INRIA's extent."""
    centres = torch.stack([v.camera.centre for v in views])
    return max(1e-3, 1.1 * float((centres - centres.mean(0)).norm(dim=-1).max()))


# --- where a scene starts
# ---------------------------------------------------------------------------


def initial_scene(dataset: Dataset, sh_degree: int, generator: torch.Generator) -> Gaussians:
    """Round splats at the sparse points, as wide as their neighbours are far; random ones if
    none.
    """
    points, colors = dataset.points, dataset.point_colors
    if points is None or len(points) < 4:
        points, colors = _random_points(dataset.views, 20_000, generator), None
    points = points.float()
    colors = torch.full_like(points, 0.5) if colors is None else colors.float()
    spacing = neighbour_distance(points).clamp_min(1e-7)
    # wide enough to close the surface at once: holes are what a short fit never fills
    log_scales = spacing.log()[:, None].expand(-1, 3)
    sh = torch.zeros(len(points), (sh_degree + 1) ** 2, 3)
    sh[:, 0] = (colors - 0.5) / SH_DC
    quats = torch.zeros(len(points), 4)
    quats[:, 0] = 1
    logits = torch.full((len(points),), float(torch.logit(torch.tensor(0.2))))
    return Gaussians(points.contiguous(), quats, log_scales.clone(), logits, sh)


def neighbour_distance(points: Float[Tensor, "n 3"], neighbours: int = 3) -> Float[Tensor, " n"]:
    """Root mean squared distance to the nearest few other points."""
    from scipy.spatial import KDTree

    located = points.double().numpy()
    distance, _ = KDTree(located).query(located, k=min(neighbours + 1, len(points)), workers=-1)
    return torch.from_numpy(distance[:, 1:]).square().mean(-1).sqrt().to(points.dtype)


def _random_points(
    views: tuple[View, ...], count: int, generator: torch.Generator
) -> Float[Tensor, "n 3"]:
    """Points in the ball that the cameras look into."""
    centres = torch.stack([v.camera.centre for v in views])
    middle = centres.mean(0)
    radius = (centres - middle).norm(dim=-1).max().clamp_min(1e-3)
    direction = torch.randn(count, 3, generator=generator, dtype=centres.dtype)
    direction = torch.nn.functional.normalize(direction, dim=-1)
    distance = torch.rand(count, 1, generator=generator, dtype=centres.dtype) ** (1 / 3)
    return (middle + 1.5 * radius * distance * direction).float()


# --- more Gaussians where they are missing
# ----------------------------------------------------------


class _Gradients:
    """Mean positional gradient of each Gaussian, as seen on screen."""

    def __init__(self, count: int) -> None:
        self.total, self.seen = torch.zeros(count), torch.zeros(count)

    @torch.no_grad()
    def add(self, gradient: Float[Tensor, "n 3"], scene: Gaussians, camera: Camera) -> None:
        # d/d(pixel) is d/d(world) times depth over focal length; counted per half picture, as
        # INRIA does
        pose = camera.world_to_camera.to(scene.means)
        depth = scene.means @ pose[2, :3] + pose[2, 3]
        size = gradient.norm(dim=-1) * depth.abs() / camera.fx * (camera.width / 2)
        self.total += size
        self.seen += size > 0

    @property
    def mean(self) -> Float[Tensor, " n"]:
        return self.total / self.seen.clamp_min(1)


@torch.no_grad()
def densify(
    scene: Gaussians,
    gradients: Float[Tensor, " n"],
    settings: FitSettings,
    generator: torch.Generator,
) -> tuple[Gaussians, Tensor, Tensor]:
    """Prune what is transparent, divide what pulls hardest; (scene, row it came from, is new).

    A dividing Gaussian becomes two, drawn from itself and 1.6 times smaller (Kerbl et al., split);
    both have the opacity that together looks like the one: 1 - sqrt(1 - o).
    """
    alive = scene.opacities > min(settings.prune_opacity, float(scene.opacities.max()) / 2)
    room = max(0, settings.max_gaussians - int(alive.sum()))
    wanted = min(room, int(settings.densify_fraction * int(alive.sum())))
    strongest = torch.where(alive, gradients, -1.0).topk(wanted).indices
    parents = scene[strongest]
    rotation = rotation_matrices(parents.quats)
    halves = []
    for _ in range(2):
        draw = torch.randn(len(parents), 3, generator=generator) * parents.scales
        shifted = parents.means + (rotation @ draw[:, :, None]).squeeze(-1)
        opacity = 1 - (1 - parents.opacities.clamp_max(0.999)).sqrt()
        halves.append(
            replace(
                parents,
                means=shifted,
                log_scales=parents.log_scales - torch.log(torch.tensor(1.6)),
                logit_opacities=torch.logit(opacity),
            )
        )
    alive[strongest] = False
    kept = alive.nonzero().squeeze(-1)
    origin = torch.cat((kept, strongest, strongest))
    fresh = torch.arange(len(origin)) >= len(kept)
    return concatenate(scene[kept], *halves), origin, fresh


def _lower_opacity(scene: Gaussians) -> Gaussians:
    limit = torch.logit(torch.tensor(RESET_OPACITY))
    return replace(scene, logit_opacities=scene.logit_opacities.clamp_max(limit))
