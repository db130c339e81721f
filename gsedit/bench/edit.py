"""Error of an edit against seconds, at held-out cameras, outside the edit's clock."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.results import markdown_table, write_measurements, write_text
from gsedit.datasets.dataset import Dataset, capture
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editing.edit import edit_steps
from gsedit.editors import make_editor
from gsedit.editors.looks.recipe import parse
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.measures.agreement import spread
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.paper.actions import Action, Strategy
from gsedit.paper.edit_views import MEASURE, sample_views
from gsedit.paper.progress import Work
from gsedit.paper.session import Session, render_edited
from gsedit.paper.settings import EditSettings
from gsedit.paper.strategies import find_strategy
from gsedit.runs.events import Event, returned
from gsedit.runs.stopwatch import Stopwatch
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians

ROWS, TABLE = "edit.jsonl", "edit.md"
MEASURED_VIEWS = 4
"""Held-out cameras at which errors are measured."""
SPARSER = 1.08
"""Points of a curve lie this factor of steps apart, or 10 steps where that is more."""
EVERY = 10
REFERENCE_SEED, REFERENCE_DRAWS = 12345, 4
"""First seed, and number, of the editor's pictures of held-out views, equal for all runs on a
scene."""
EXACT, OWN = "the exact edit", "the editor's own pictures of held-out views"


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
        finals = torch.stack(list(render_edited(session, self.views).values()))
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


@dataclass(frozen=True)
class EditPlan:
    """An edit of the built-in scene, and its size."""

    instruction: str = "turn the bear into a bronze statue"
    strategy: str = "single-pass"
    options: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the strategy that differ from its defaults."""
    gaussians: int = 30_000
    cameras: int = 32
    """Views on a ring; every eighth is held out."""
    size: int = 128
    """Side of a view, pixels."""
    patches: int = 16
    """Crops a fitting step renders."""
    patch: int = 32
    """Side of a crop, pixels."""


QUICK = EditPlan(gaussians=1_000, cameras=9, size=64, patches=1)


def edit_to_folder(folder: Path, plan: EditPlan) -> Iterator[Event | Point]:
    """Do the edit with the editor `closed-form`, whose exact result is known, and write the error
    as it falls: ROWS, then TABLE.
    """
    rows: list[Point] = []
    yield from write_measurements(_measure(plan), folder / ROWS, rows)
    write_text(folder / TABLE, table(rows) + "\n")


def _measure(plan: EditPlan) -> Iterator[Event | Point]:
    solid = demo_scene()
    scene = surface_gaussians(solid, plan.gaussians, torch.Generator().manual_seed(0))
    cameras = ring_cameras(solid, plan.cameras, plan.size)
    names = [f"view_{i:03d}" for i in range(plan.cameras)]
    update = UpdateSettings(patches=plan.patches, patch=plan.patch)
    observer = Observer()
    steps = edit_steps(
        scene,
        plan.instruction,
        editor=make_editor("closed-form"),
        generator=torch.Generator().manual_seed(0),
        views=Dataset(capture(scene, cameras, names)),
        settings=EditSettings(update=update, held_out_edits=0, region="all", coverage=1.0),
        strategy=Observed(find_strategy(plan.strategy)(**plan.options), observer),
    )
    yield from (item for item in steps if isinstance(item, Event))
    yield from observer.points


def table(points: Iterable[Point]) -> str:
    """A Markdown table of seconds, those in the 2D editor, fitting steps, error and PSNR."""
    points = list(points)
    nearest = nearest_truth(points)
    rows = [
        (f"{p.seconds:.1f}", f"{p.editing:.1f}", str(p.steps), f"{p.errors[nearest]:.4f}",
         f"{psnr_from_rmse(p.errors[nearest]):.1f}")
        for p in points
    ]  # fmt: skip
    return markdown_table(("seconds", "in the 2D editor", "steps", "RMSE", "PSNR, dB"), rows)


def nearest_truth(points: Sequence[Point]) -> int:
    """Index of the variant of the exact edit that the curve ends nearest to."""
    last = points[-1].errors
    return last.index(min(last))
