"""Strategies, and the actions that they consist of: edit some views, fit the scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from math import inf
from typing import Any, Protocol, runtime_checkable

import torch

from gsedit.capture.fitting.solve import solve_colors, trusting_penalty
from gsedit.capture.fitting.strokes import leading_views, led, stroke_steps
from gsedit.capture.fitting.update import Target, crops_needed, update_steps
from gsedit.errors import InputError
from gsedit.paper.edit_views import edit_views
from gsedit.paper.editors.painter.drawn import ON_PAPER
from gsedit.paper.evaluate import measure_progress
from gsedit.paper.session import Session, region_masks, seen_gaussians
from gsedit.run.events import Event
from gsedit.views.dataset import View
from rasterizer.color_weights import ColorWeights
from rasterizer.scene import Gaussians

REPORT_EVERY_STEPS = 10
"""Optimizer steps between two events with the loss."""


def _edited(session: Session) -> dict[int, View]:
    """The edited views, by index. Raises InputError where a checkpoint left none."""
    targets = session.progress.edited.targets
    if not targets:
        raise InputError("the checkpoint has no edited views to fit: remove it, and start again")
    return targets


def _targets(session: Session) -> list[Target]:
    """The edited views as they are fitted; only those that changed since the last time are new."""
    edited, patch = session.progress.edited, session.request.settings.update.patch
    masks = region_masks(session, _edited(session))
    region = None if masks is None else session.region
    for (i, view), mask in zip(edited.targets.items(), masks or repeat(None)):
        of = view, region
        if i not in edited.fitted or any(a is not b for a, b in zip(edited.fitted[i][0], of)):
            edited.fitted[i] = of, Target(view, mask, patch)
    return [edited.fitted[i][1] for i in edited.targets]


MAX_STEPS_AT_ONCE = 10
"""Most optimizer steps in one action: an edit can be interrupted between any two actions."""


class Action(Protocol):
    """A part of an edit; all that it changes is in the session's progress."""

    def __call__(self, session: Session) -> Iterator[Event]:
        """Run the action; yields its events."""
        ...


@runtime_checkable
class Strategy(Protocol):
    """An order in which views are edited and the scene is fitted to them.

    It may have a class attribute `fits_pictures`, False where it renders the optimizer's scene
    itself.
    """

    def schedule(self, session: Session) -> Iterator[Action]:
        """The actions of an edit, in order.

        They depend on the settings and on the plan of views, never on chance or on what an action
        found: an edit that is resumed skips those that are done. Chance belongs into the actions,
        from the generator of the request.
        """
        ...


class RollbackAction(Action):
    """Base class of actions that never touch the optimizer: on failure a checkpoint is made of the
    session as it was before."""


@dataclass(frozen=True)
class EditViews(RollbackAction):
    """Edit the views with these indices together: batch `step` of `steps`, see `edit_views`."""

    batch: tuple[int, ...]
    step: int
    steps: int

    def __call__(self, session: Session) -> Iterator[Event]:
        yield from edit_views(session, self.batch, step=self.step, steps=self.steps)


@dataclass(frozen=True)
class Update:
    """Steps `first` to `last` (not included) of a round of fitting the edited views."""

    first: int
    last: int
    round_steps: int
    """Steps of the whole round, over which the learning rates fall."""
    done: int
    """Steps of the edit that came before the round."""
    total: int
    """Steps of the whole edit."""

    def __call__(self, session: Session) -> Iterator[Event]:
        request, progress = session.request, session.progress
        stopwatch, update = progress.stopwatch, request.settings.update
        span, targets = range(self.first, self.last), _targets(session)
        share = sum(target.share for target in targets) / len(targets)
        update = replace(update, patches=crops_needed(update.patches, share))
        with stopwatch.stage("update"):
            losses = update_steps(
                progress.optimizer,
                targets,
                seen_gaussians(session),
                span,
                self.round_steps,
                update,
                request.features,
                request.generator,
            )
            for step, loss in enumerate(losses, start=self.done + self.first + 1):
                progress.work.steps += 1
                if step % 50 == 0:  # renders three views
                    yield measure_progress(session, step, self.total, loss)
                elif step % REPORT_EVERY_STEPS == 0:
                    yield Event("update", stopwatch.seconds, step, self.total, loss)


@dataclass(frozen=True)
class Solve:
    """Solve for the colors of the region that fit all targets best, after `step` of `total`.

    Opacities and geometry stay.
    """

    step: int
    total: int

    def __call__(self, session: Session) -> Iterator[Event]:
        request, progress, inside = session.request, session.progress, session.region.inside
        optimizer, targets = progress.optimizer, _edited(session)
        with progress.stopwatch.stage("update"):
            optimizer.raise_negative_colors(inside)
            start, views = optimizer.scene.detach(), list(targets.values())
            how: dict[str, Any] = {}
            if request.keeps_strokes:
                how["weights"] = _led_views(session, start, targets)
                how["band_penalty"] = inf  # a stroke looks the same from all sides
                start = replace(start, sh=start.sh.clone())
                start.sh[inside, 0 if ON_PAPER.intersection(request.rules) else 1 :] = 0
            else:
                how["penalty"] = trusting_penalty(start, views, inside)
            solved = list(solve_colors(start, views, inside, **how))
            if solved:
                progress.work.followed = solved[-1].followed
                progress.work.map_error = solved[-1].map_error
                _take(session, solved[-1].scene, len(solved))
            loss = solved[-1].mse if solved else None
            yield measure_progress(session, self.step, self.total, loss)
            if request.keeps_strokes:
                yield from _keep_strokes(session, views, how["weights"])


def _take(session: Session, scene: Gaussians, steps: int) -> None:
    """Make this the session's scene, after so many steps."""
    every = torch.ones(len(scene), dtype=torch.bool)
    session.progress.work.steps += steps
    session.progress.optimizer.replace(scene, torch.arange(len(scene)), fresh=every)


def _led_views(
    session: Session, scene: Gaussians, targets: Mapping[int, View]
) -> list[ColorWeights]:
    """Weights of the targets' views, each where it leads."""
    views, leading = list(targets), session.request.leading
    if leading is not None and set(leading.unique().tolist()) <= {-1, *views}:
        places = torch.full((len(session.weights),), -1)
        places[views] = torch.arange(len(views))
        leading = torch.where(leading < 0, -1, places[leading])
    else:  # of views that are not planned by it, or of a region that they told
        leading = leading_views(session.weights[views] * session.region.inside, scene.means)
    return [led(scene, view.camera, leading == i) for i, view in enumerate(targets.values())]


def _keep_strokes(
    session: Session, targets: Sequence[View], weights: Sequence[ColorWeights]
) -> Iterator[Event]:
    """Descend the loss of the paper from the solved scene; yields events."""
    request, stopwatch = session.request, session.progress.stopwatch
    total = request.settings.update.strokes
    found = stroke_steps(
        session.scene, targets, session.region.inside, total, request.features,
        request.generator, weights=weights,
    )  # fmt: skip
    for step, item in enumerate(found, start=1):
        if isinstance(item, Gaussians):
            _take(session, item, total)
        elif step % REPORT_EVERY_STEPS == 0:
            yield Event("strokes", stopwatch.seconds, step, total, item)


def fit_round(session: Session, steps: int, *, done: int, total: int) -> Iterator[Action]:
    """The actions that fit all targets: a solve where it is exact, else a round of `steps`.

    `done` of `total` steps of the edit came before the round.
    """
    if session.request.solves:
        yield Solve(done + steps, total)
    else:
        yield from update_round(steps, done=done, total=total)


def update_round(
    steps: int, *, done: int, total: int, span: range | None = None
) -> Iterator[Update]:
    """Yield the updates of a round of `steps`, or of the part `span` of it, a few steps at a time.

    `done` of `total` steps of the edit came before the round.
    """
    span = span or range(steps)
    for first in range(span.start, span.stop, MAX_STEPS_AT_ONCE):
        yield Update(first, min(first + MAX_STEPS_AT_ONCE, span.stop), steps, done, total)
