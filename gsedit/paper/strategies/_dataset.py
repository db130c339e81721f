"""The dataset update of Instruct-NeRF2NeRF (Haque et al. 2023): pictures are replaced one by one.

The dataset holds a picture of every view, at first the unedited ones. Each edit replaces one, and
sampling starts from the scene as it is then: the views come to agree through the scene alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch

from gsedit.paper.actions import Action, RollbackAction, Solve, update_round
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.edit_views import edit_alone
from gsedit.paper.session import Session
from gsedit.paper.strategies._settings import DatasetUpdate
from gsedit.run.events import Event
from gsedit.views.dataset import View

LEAST_NOISE, MOST_NOISE = 0.02, 0.98
"""Noise levels at which an edit starts, fractions of the schedule: Instruct-NeRF2NeRF's."""


def dataset_views(session: Session, own: DatasetUpdate) -> tuple[int, ...]:
    """Indices of the views of the dataset, in the order in which they are edited.

    All views are taken in a mixed order, which is the same in every edit: next to each other in a
    capture, they would show the same part of the scene.
    """
    if own.dataset_views == "planned":
        return session.plan.views
    mixed = torch.randperm(len(session.request.views), generator=torch.Generator().manual_seed(0))
    return tuple(mixed.tolist())


@dataclass(frozen=True)
class ShowUnedited(RollbackAction):
    """Put the unedited pictures of these views into the dataset, where there is no edited one."""

    views: tuple[int, ...]

    def __call__(self, session: Session) -> Iterator[Event]:
        targets, stopwatch = session.progress.edited.targets, session.progress.stopwatch
        with stopwatch.stage("dataset"):
            for i in self.views:
                if i not in targets:
                    image = session.within_region(i, session.unedited.condition(i))
                    view = session.request.every_view[i]
                    targets[i] = View(view.name, view.camera, image)
        yield Event("dataset", stopwatch.seconds, note=f"{len(self.views)} unedited pictures")


@dataclass(frozen=True)
class EditAlone(RollbackAction):
    """Edit one view from a noise level that is drawn anew: edit `step` of `steps`."""

    view: int
    step: int
    steps: int

    def __call__(self, session: Session) -> Iterator[Event]:
        draw = float(torch.rand((), generator=session.request.generator))
        strength = LEAST_NOISE + (MOST_NOISE - LEAST_NOISE) * draw
        sampler = alone(session.request.settings.sampler, strength)
        yield from edit_alone(session, self.view, sampler, step=self.step, steps=self.steps)


def alone(sampler: SamplerSettings, strength: float) -> SamplerSettings:
    """The settings for a view on its own from that noise level, with fewer steps where the
    schedule has fewer levels below it; None stays for the editor's own."""
    most = max(1, int(1000 * strength))
    steps = sampler.steps if sampler.step_count <= most else most
    return replace(sampler, strength=strength, steps=steps, consensus=False, noise="independent")


def in_turn(
    session: Session, own: DatasetUpdate, steps: int, *, done: int, total: int
) -> Iterator[Action]:
    """Edit a view, fit the dataset for `steps_between` steps, go on with the next view, over and
    over until `steps` are done; the learning rates fall over all of them. A few steps on crops cost
    less than to solve for the whole dataset after every view: that is done once, at the end.

    `done` of `total` steps of the edit came before.
    """
    views, starts = dataset_views(session, own), range(0, steps, own.steps_between)
    for number, start in enumerate(starts):
        view = views[number % len(views)]
        yield EditAlone(view, number + 1, len(starts))
        span = range(start, min(start + own.steps_between, steps))
        yield from update_round(steps, done=done, total=total, span=span)
    if session.request.solves:
        yield Solve(done + steps, total)
