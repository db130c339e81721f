"""Error of an edit against seconds, at held-out cameras, outside the edit's clock."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.measures.agreement import spread
from gsedit.paper.actions import Action, Strategy
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.edit_views import MEASURE, sample_views
from gsedit.paper.editors.looks.recipe import parse
from gsedit.paper.progress import Work
from gsedit.paper.session import Session
from gsedit.run.events import returned
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.picture import render_picture

MEASURED_VIEWS = 4
"""Held-out cameras at which errors are measured."""
SPARSER = 1.08
"""Points of a curve lie this factor of steps apart, or 10 steps where that is more."""
EVERY = 10
REFERENCE_SEED, REFERENCE_DRAWS = 12345, 4
"""First seed, and number, of the editor's pictures of held-out views, equal for all runs on a
scene."""
EXACT, OWN = "the exact edit", "the editor's own pictures of held-out views"


def rendered(session: Session, views: Sequence[int]) -> Float[Tensor, "v h w 3"]:
    """Pictures of the whole scene as it is now, in [0, 1]."""
    request = session.request
    scene = session.scene if request.coarse is None else session.whole_scene()
    cameras = [request.every_view[i].camera for i in views]
    execution = request.settings.execution
    return torch.stack([render_picture(scene, camera, execution) for camera in cameras])


@dataclass(frozen=True)
class Point:
    """Progress of an edit after one of its actions. No time of measuring is in it."""

    seconds: float
    """Wall clock since the first action."""
    editing: float
    """Part of `seconds` that the 2D editor took."""
    steps: int
    """Number of steps of the optimizer."""
    calls: int
    """Views that the editor was asked for."""
    evaluations: int
    """Evaluations of its network: a view at one noise level under one condition is one."""
    errors: tuple[float, ...]
    """RMSE at held-out cameras to each picture of the edit that is right: variants of the exact
    edit, or the editor's own pictures."""
    cpu: float
    """Processor seconds of the process since the first action."""
    editing_cpu: float
    """Part of `cpu` that the 2D editor took."""


@dataclass(frozen=True)
class Observed:
    """A strategy that is looked at between its actions."""

    strategy: Strategy
    observer: Observer

    def schedule(self, session: Session) -> Iterator[Action]:
        self.observer.begin(session)
        for action in self.strategy.schedule(session):
            self.observer.look(session)
            yield action
        self.observer.look(session, due=True)


@dataclass(eq=False)
class Observer:
    """Measures the scene at held-out cameras; its own time is not the edit's."""

    points: list[Point] = field(default_factory=list)
    truths: Float[Tensor, "k v h w 3"] = field(default_factory=lambda: torch.zeros(0))
    """Pictures that are right, at the held-out cameras."""
    kind: str = EXACT
    views: tuple[int, ...] = ()
    session: Session | None = None
    own: Float[Tensor, "1 v h w 3"] | None = None
    """The editor's own pictures at these views: given, where an earlier observer of the same edit
    made them."""
    _next: float = 0.0
    _seconds: float = 0.0
    _cpu: float = 0.0
    _editing_cpu: float = 0.0
    _sampled: float = 0.0
    _left: tuple[float, float] | None = None
    """Wall clock and processor time when the last look ended."""

    def begin(self, session: Session) -> None:
        """Make the pictures that are right; the clock starts when this ends."""
        self.session = session
        self.views = spread(session.request.held_out_indices, MEASURED_VIEWS)
        if not self.views:
            raise UsageError("no view is held out: there is nothing to measure at")
        renderings = [session.unedited.rendering(i) for i in self.views]
        unedited = torch.stack([r.color.clamp(0, 1) for r in renderings])
        if session.request.editor.capabilities.find_ground_truth is not None:
            right = parse(session.request.prompt).variants(unedited)
        else:
            right = _asked(session, self.views)[None] if self.own is None else self.own
            self.kind, self.own = OWN, right
        # where nothing is shown no Gaussian can follow an edit of the background
        shown = torch.stack([r.alpha for r in renderings])[..., None]
        self.truths = torch.lerp(unedited.expand_as(right), right, shown.expand_as(right))
        self.points, self._left = [], None
        self.look(session, due=True)

    def look(self, session: Session, *, due: bool = False) -> None:
        """A point of the curve, if it is due."""
        editing = session.progress.stopwatch.stages.get("sample", 0.0)
        if self._left is not None:
            seconds, cpu = time.monotonic() - self._left[0], time.process_time() - self._left[1]
            self._editing_cpu += (editing - self._sampled) * cpu / max(seconds, 1e-9)
            self._seconds, self._cpu = self._seconds + seconds, self._cpu + cpu
        if due or session.progress.work.steps >= self._next:
            self._measure(session, editing)
        self._sampled, self._left = editing, (time.monotonic(), time.process_time())

    def _measure(self, session: Session, editing: float) -> None:
        finals = rendered(session, self.views)
        errors = (self.truths - finals).double().square().mean((1, 2, 3, 4)).sqrt()
        work = session.progress.work
        self.points.append(
            Point(self._seconds, editing, work.steps, work.calls, work.evaluations,
                  tuple(errors.tolist()), self._cpu, self._editing_cpu)
        )  # fmt: skip
        self._next = max(work.steps + EVERY, SPARSER * work.steps)


def _asked(session: Session, views: Sequence[int]) -> Float[Tensor, "v h w 3"]:
    """The editor's pictures of these views of the unedited scene, on average over some draws.

    Each view is asked for alone, with noise of its own: the reference favors no way of making
    views agree. The edit goes on as if nothing had been asked.
    """
    sampler = SamplerSettings(precision="float32", consensus=False, noise="independent")
    start, total = {i: session.unedited.picture(i) for i in views}, torch.zeros(())
    for seed in range(REFERENCE_SEED, REFERENCE_SEED + REFERENCE_DRAWS):
        generator = torch.Generator().manual_seed(seed)
        aside = replace(
            session,
            request=replace(session.request, generator=generator),
            progress=replace(session.progress, stopwatch=Stopwatch(), work=Work()),
        )
        steps = sample_views(aside, views, (), None, sampler, start=start, stage=MEASURE)
        total = total + torch.stack(returned(steps))
    return total / REFERENCE_DRAWS


def nearest_truth(points: Sequence[Point]) -> int:
    """Index of the variant of the exact edit that the curve ends nearest to."""
    last = points[-1].errors
    return last.index(min(last))
