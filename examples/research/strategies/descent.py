"""A strategy that edits no picture: it descends a loss of random views of the scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.capture.fitting.update import FINAL_RATE
from gsedit.paper.actions import MAX_STEPS_AT_ONCE, REPORT_EVERY_STEPS, Action
from gsedit.paper.session import Session, seen_gaussians
from gsedit.run.events import Event
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

VOX_E_WEIGHT = 200 / (4 * 64 * 64)
"""Vox-E has 200, beside a sum over the latents of Stable Diffusion at 512x512."""
EPSILON = 1e-7
"""Added to the product of standard deviations, as in Vox-E's code."""
CONSTANT = 1e-10
"""Variance below which the original has no structure that could be kept: rounding."""


def correlation(a: Float[Tensor, "n c"], b: Float[Tensor, "n c"]) -> Float[Tensor, " c"]:
    """Pearson's, channel by channel, in [-1, 1]; 1 where b is constant."""
    a, b = a - a.mean(0), b - b.mean(0)
    variance = b.square().mean(0)
    # the root has no gradient at 0: where one of them is constant, it would be NaN
    product = (a.square().mean(0) * variance).clamp_min(EPSILON**2)
    found = (a * b).mean(0) / (product.sqrt() + EPSILON)
    return torch.where(variance > CONSTANT, found, 1.0)


def correlation_loss(
    scene: Gaussians, original: Gaussians, rows: Bool[Tensor, " n"]
) -> Float[Tensor, ""]:
    """(1 - corr(o, o0)) + mean over R, G, B of (1 - corr(c, c0)), in [0, 4], 0 for the original.

    o are opacities in [0, 1], c base colors, of the Gaussians in `rows`. Vox-E has the first term
    alone; opacities alone would not hold an edit of colors.
    """
    parts = ((each.opacities[:, None], each.sh[:, 0]) for each in (scene[rows], original[rows]))
    opacity, color = (correlation(a, b) for a, b in zip(*parts))
    return (1 - opacity).mean() + (1 - color).mean()


@dataclass(frozen=True)
class Descent(ABC):
    """Descend a loss on random views; only the Gaussians of the region that they see move."""

    fits_pictures: ClassVar[bool] = False
    """It renders the scene itself, with gradients."""
    dataset_views: ClassVar[str] = "all"
    """It renders views that are not in the plan."""

    total_steps: int = 400
    """Steps of one view each."""
    structure_weight: float = VOX_E_WEIGHT
    """Weight of `correlation_loss`, beside 1 of the loss; 0: none."""

    def schedule(self, session: Session) -> Iterator[Action]:
        """A few steps at a time."""
        for first in range(0, self.total_steps, MAX_STEPS_AT_ONCE):
            yield Steps(self, first, min(first + MAX_STEPS_AT_ONCE, self.total_steps))

    @abstractmethod
    def camera(self, session: Session, view: int) -> Camera:
        """The camera from which that view is rendered."""

    @abstractmethod
    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(loss that is descended, number that is reported) of the scene's picture of that view."""


@dataclass(frozen=True)
class Steps:
    """Steps `first` to `last` (not included) of a descent; its rate falls as in an update."""

    descent: Descent
    first: int
    last: int

    def __call__(self, session: Session) -> Iterator[Event]:
        optimizer, request = session.progress.optimizer, session.request
        views, total = tuple(range(len(request.views))), self.descent.total_steps
        seen = seen_gaussians(session, views)
        if self.first == 0:
            optimizer.raise_negative_colors(seen)
        for step in range(self.first, self.last):
            view = int(torch.randint(len(views), (), generator=request.generator))
            camera = self.descent.camera(session, view)
            image = render(optimizer.scene, camera, execution=request.settings.execution).color
            loss, value = self.descent.loss(session, view, image)
            held = correlation_loss(optimizer.scene, request.scene, seen)
            (loss + self.descent.structure_weight * held).backward()
            optimizer.step(1 - (1 - FINAL_RATE) * step / max(1, total - 1), only=seen)
            session.progress.work.steps += 1
            if (step + 1) % REPORT_EVERY_STEPS == 0 or step + 1 == total:
                seconds = session.progress.stopwatch.seconds
                yield Event("update", seconds, step + 1, total, value)
