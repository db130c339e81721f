"""The default recipe of gsplat 1.5 (examples/simple_trainer.py, DefaultStrategy) with our renderer.

Facts and constants are gsplat's (Ye et al. 2024, arXiv 2409.06765), which are those of Kerbl et al.
2023; the code is ours. Two things differ: the gradient of a center on the screen is that in the
world, projected (our renderer has no other), and lowered opacities keep their moments in Adam.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.capture.fitting.densify import ScreenGradients
from gsedit.capture.fitting.initial import round_gaussians
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.photometric import photometric, supervised
from gsedit.views.dataset import Dataset
from rasterizer.blending.choose import is_compiled
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.project import rotation_matrices
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate
from research.fit.clock import Moment

RATES = {"means": 1.6e-4, "log_scales": 5e-3, "quats": 1e-3, "logit_opacities": 5e-2, "sh": 2.5e-3}
"""That of positions times the scene's extent; view-dependent color 1/20 of "sh"."""


@dataclass(frozen=True)
class GsplatSettings:
    """The recipe's numbers, in its steps of 30,000."""

    steps: int = 30_000
    final_rate: float = 0.01
    """Rate of positions at the last step."""
    dssim_weight: float = 0.2
    sh_degree: int = 3
    sh_every: int = 1000
    initial_opacity: float = 0.1
    refine_start: int = 500
    refine_stop: int = 15_000
    refine_every: int = 100
    reset_every: int = 3000
    grow_gradient: float = 2e-4
    """Mean gradient on a screen of [-1, 1] above which a Gaussian is doubled."""
    grow_scale: float = 0.01
    """Share of the extent: smaller Gaussians are copied, larger ones divided."""
    prune_opacity: float = 0.005
    prune_scale: float = 0.1
    """Share of the extent: larger Gaussians are removed after the first reset."""
    reset_opacity: float = 0.01


class _Counted(ScreenGradients):
    """On a screen of [-1, 1] a side."""

    @torch.no_grad()
    def add(self, gradient: Float[Tensor, "n 3"], scene: Gaussians, camera: Camera) -> None:
        """Count one picture: a gradient by pixels, times half the picture's size."""
        pose = camera.world_to_camera.to(scene.means)
        depth = scene.means @ pose[2, :3] + pose[2, 3]
        x, y = (gradient @ pose[:2, :3].T).unbind(-1)
        size = depth.abs() * torch.hypot(
            x * (camera.width / 2 / camera.fx), y * (camera.height / 2 / camera.fy)
        )
        self.total += size
        self.pictures += size > 0


def gsplat_fit(
    data: Dataset,
    seconds: float,
    *,
    moments: int,
    clock: Callable[[], float],
    generator: torch.Generator,
    execution: Execution = AUTO,
    settings: GsplatSettings = GsplatSettings(),
) -> Iterator[Moment]:
    """Fit to the training photos for so many of the clock's seconds; the scene at evenly spaced
    moments, the last at the end. The dataset must have points.
    """
    run = _Run(data, generator, execution, settings)
    step, due = 0, 1
    while clock() < seconds:
        run.step(step)
        step += 1
        if (spent := clock()) >= due * seconds / moments and spent < seconds:
            due = int(spent * moments / seconds) + 1
            yield Moment(spent, step, run.optimizer.scene.detach())
    yield Moment(clock(), step, run.optimizer.scene.detach())


class _Run:
    """A fit in progress."""

    def __init__(
        self,
        data: Dataset,
        generator: torch.Generator,
        execution: Execution,
        settings: GsplatSettings,
    ) -> None:
        self.views, _ = data.split()
        centers = torch.stack([view.camera.center for view in self.views])
        self.extent = 1.1 * float((centers - centers.mean(0)).norm(dim=-1).max())
        self.settings, self.generator, self.execution = settings, generator, execution
        scene = _initial(data, settings)
        rates = {**RATES, "means": RATES["means"] * self.extent}
        self.optimizer = SceneOptimizer(scene, rates, compiled=is_compiled(execution))
        self.counted = _Counted(len(scene))
        self.order: list[int] = []
        self.last = 0
        """The recipe's step before."""

    def step(self, now: int) -> None:
        """The recipe's step `now`: one photo, and what is due since the step before."""
        settings, optimizer = self.settings, self.optimizer
        if not self.order:
            self.order = torch.randperm(len(self.views), generator=self.generator).tolist()
        view = self.views[self.order.pop()]
        scene = optimizer.scene
        degree = min(now // settings.sh_every, settings.sh_degree)
        shown = replace(scene, sh=scene.sh[:, : (degree + 1) ** 2])
        picture = render(shown, view.camera, execution=self.execution).color
        compiled = is_compiled(self.execution)
        picture, photo = supervised(picture, view.image, view.mask)
        photometric(picture, photo, settings.dssim_weight, compiled=compiled).backward()
        gradient = scene.means.grad
        optimizer.step({"means": settings.final_rate ** (now / settings.steps)})
        if gradient is not None and now < settings.refine_stop:
            self.counted.add(gradient, scene, view.camera)
            self._refine(now)
        self.last = now

    def _passed(self, now: int, every: int) -> bool:
        return now // every > self.last // every

    @torch.no_grad()
    def _refine(self, now: int) -> None:
        settings, optimizer = self.settings, self.optimizer
        if now > settings.refine_start and self._passed(now, settings.refine_every):
            scene = optimizer.scene.detach()
            high = self.counted.mean > settings.grow_gradient
            grown, origin, fresh = _grown(
                scene, high, settings.grow_scale * self.extent, self.generator
            )
            kept = grown.opacities >= settings.prune_opacity
            if now > settings.reset_every:
                kept &= grown.scales.amax(-1) <= settings.prune_scale * self.extent
            rows = kept.nonzero().squeeze(-1)
            optimizer.replace(grown[rows], origin[rows], fresh[rows])
            self.counted = _Counted(len(rows))
        if self._passed(now, settings.reset_every):
            scene = optimizer.scene.detach()
            limit = torch.logit(torch.tensor(settings.reset_opacity))
            lowered = replace(scene, logit_opacities=scene.logit_opacities.clamp_max(limit))
            optimizer.replace(lowered, torch.arange(len(scene)), torch.zeros(len(scene)).bool())


def _initial(data: Dataset, settings: GsplatSettings) -> Gaussians:
    """Round Gaussians at the sparse points."""
    assert data.points is not None, "the recipe starts at points"
    points = data.points.float()
    colors = torch.full_like(points, 0.5) if data.point_colors is None else data.point_colors
    return round_gaussians(points, colors.float(), settings.initial_opacity, settings.sh_degree)


def _grown(
    scene: Gaussians, high: Bool[Tensor, " n"], small: float, generator: torch.Generator
) -> tuple[Gaussians, Tensor, Tensor]:
    """The scene with small Gaussians of a high gradient twice, and large ones divided in two; the
    row that each came from, and whether it is new."""
    is_small = scene.scales.amax(-1) <= small
    copied = (high & is_small).nonzero().squeeze(-1)
    divided = (high & ~is_small).nonzero().squeeze(-1)
    kept = (~(high & ~is_small)).nonzero().squeeze(-1)
    parents = scene[divided]
    rotation = rotation_matrices(parents.quats)
    halves = []
    for _ in range(2):
        draw = torch.randn(len(parents), 3, generator=generator) * parents.scales
        means = parents.means + (rotation @ draw[:, :, None]).squeeze(-1)
        log_scales = parents.log_scales - torch.tensor(1.6).log()
        halves.append(replace(parents, means=means, log_scales=log_scales))
    origin = torch.cat((kept, copied, divided, divided))
    fresh = torch.arange(len(origin)) >= len(kept)
    return concatenate(scene[kept], scene[copied], *halves), origin, fresh
