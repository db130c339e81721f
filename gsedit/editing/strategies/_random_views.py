"""Steps that render a random view of the scene, with gradients, and descend a loss of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.editing.session.fit_targets import REPORT_EVERY_STEPS
from gsedit.editing.session.session import Session, seen_gaussians
from gsedit.fitting.update import FINAL_RATE
from gsedit.runs.events import Event
from gsedit.runs.step_threads import StepThreads
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

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

    o are opacities in [0, 1], c base colors (the SH coefficients of degree 0), of the Gaussians in
    `rows`. Vox-E has the first term alone; opacities alone would not hold an edit of colors.
    """
    opacity, color = (
        correlation(part(scene)[rows], part(original)[rows]) for part in (_opacities, _colors)
    )
    return (1 - opacity).mean() + (1 - color).mean()


def _opacities(scene: Gaussians) -> Float[Tensor, "n 1"]:
    return torch.sigmoid(scene.logit_opacities)[:, None]


def _colors(scene: Gaussians) -> Float[Tensor, "n 3"]:
    return scene.sh[:, 0]


@dataclass(frozen=True)
class RandomViews(ABC):
    """Steps `first` to `last` (not included) of `round_steps`, each on a random one of the views.

    Only the Gaussians of the region that these views see move; the rates fall as in an update.
    """

    views: tuple[int, ...]
    first: int
    last: int
    round_steps: int
    structure_weight: float
    """Weight of `correlation_loss`, beside 1 of the loss."""

    def __call__(self, session: Session) -> Iterator[Event]:
        optimizer, generator = session.progress.optimizer, session.request.generator
        threads = StepThreads()
        seen = seen_gaussians(session, self.views)
        if self.first == 0:
            optimizer.raise_negative_colors(seen)
        for step in range(self.first, self.last):
            with session.progress.stopwatch.stage("update"), threads.step():
                view = self.views[int(torch.randint(len(self.views), (), generator=generator))]
                scene, camera = optimizer.scene, self.camera(session, view)
                image = render(scene, camera, execution=session.request.settings.execution).color
                loss, value = self.loss(session, view, image)
                if self.structure_weight:
                    held = correlation_loss(scene, session.request.scene, seen)
                    loss = loss + self.structure_weight * held
                loss.backward()
                fall = (1 - FINAL_RATE) * step / max(1, self.round_steps - 1)
                optimizer.step(1 - fall, only=seen)
            session.progress.work.steps += 1
            yield from self.report(session, step + 1, value)

    @abstractmethod
    def camera(self, session: Session, view: int) -> Camera:
        """The camera from which that view is rendered."""

    @abstractmethod
    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(loss that is descended, number that is reported) of the scene's picture of that view."""

    def report(self, session: Session, step: int, value: float) -> Iterator[Event]:
        """Yield an event with the loss now and then, after `step` steps."""
        if step % REPORT_EVERY_STEPS == 0 or step == self.round_steps:
            yield Event("update", session.progress.stopwatch.seconds, step, self.round_steps, value)
