"""Steps that render a random view of the scene, with gradients, and descend a loss of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.fitting.correlation import correlation_loss
from gsedit.fitting.update import FINAL_RATE
from gsedit.reports.events import Event
from gsedit.session.fit_targets import REPORT_EVERY
from gsedit.session.session import Session
from rasterizer.camera import Camera
from rasterizer.render import render


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
    """Of `correlation_loss` beside the loss."""

    def __call__(self, session: Session) -> Iterator[Event]:
        optimiser, generator = session.optimiser, session.request.generator
        seen = session.seen_from(self.views)
        if self.first == 0:
            optimiser.raise_negative_colours(seen)
        for step in range(self.first, self.last):
            with session.stopwatch.stage("update"):
                view = self.views[int(torch.randint(len(self.views), (), generator=generator))]
                scene, camera = optimiser.scene, self.camera(session, view)
                image = render(scene, camera, execution=session.settings.execution).color
                loss, value = self.loss(session, view, image)
                if self.structure_weight:
                    held = correlation_loss(scene, session.request.scene, seen)
                    loss = loss + self.structure_weight * held
                loss.backward()
                fall = (1 - FINAL_RATE) * step / max(1, self.round_steps - 1)
                optimiser.step(1 - fall, only=seen)
            session.work.steps += 1
            yield from self.report(session, step + 1, value)

    @abstractmethod
    def camera(self, session: Session, view: int) -> Camera:
        """From where that view is rendered."""

    @abstractmethod
    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(what is descended, the number that is reported), of the scene's picture of that view."""

    def report(self, session: Session, step: int, value: float) -> Iterator[Event]:
        """The number now and then, after `step` steps."""
        if step % REPORT_EVERY == 0 or step == self.round_steps:
            yield Event("update", session.stopwatch.seconds, step, self.round_steps, value)
