"""Do one run, with its error at held-out cameras measured as it goes, outside its clock."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.paper.cases import load_case
from gsedit.bench.paper.runs import Point, Record, Run, read_record, write_record
from gsedit.bench.provenance import provenance
from gsedit.diffusion import SamplerSettings
from gsedit.edit import edit_steps
from gsedit.editors import make_editor
from gsedit.editors.looks.recipe import parse
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.reports.stopwatch import Stopwatch
from gsedit.session.actions import Action
from gsedit.session.edit_views import MEASURE, match_views, sample_views
from gsedit.session.held_out import shown_views
from gsedit.session.result import EditResult
from gsedit.session.session import Session, Work
from gsedit.session.settings import EditSettings
from gsedit.strategies import Strategy, find_strategy

MEASURED_VIEWS = 4
"""Held-out cameras at which errors are measured."""
SPARSER = 1.08
"""Points of a curve lie this factor of steps apart, or 10 steps where that is more."""
EVERY = 10
REFERENCE_SEED = 12345
"""Of what the editor makes of held-out views: the same for all runs on a scene."""
EXACT, OWN = "the exact edit", "the editor's own pictures of held-out views"


def run_to_files(run: Run, folder: Path) -> Record:
    """The run's record; read from the folder where it is there already.

    Otherwise the folder gets KEY.json, and KEY.png: two unedited views and what the editor made of
    them, a held-out view unedited, edited, and as it should be.
    """
    path = folder / f"{run.key}.json"
    if path.exists():
        return read_record(path)
    record, pictures = measure_run(run)
    _write_strip(folder / f"{run.key}.png", pictures)
    write_record(path, run, record)
    return record


def measure_run(run: Run) -> tuple[Record, list[Float[Tensor, "h w 3"]]]:
    """The record of a run, and its pictures."""
    scene, dataset = load_case(run.case)
    observer = _Observer()
    strategy = find_strategy(run.arm.strategy)(**run.arm.options)
    *_, result = edit_steps(
        scene,
        run.case.prompt,
        editor=make_editor(run.editor),
        generator=torch.Generator().manual_seed(run.seed),
        dataset=dataset,
        settings=_settings(run),
        strategy=_Observed(strategy, observer),
    )
    assert isinstance(result, EditResult)
    assert observer.session is not None
    return _record(observer, observer.session, result), _pictures(observer, observer.session)


def _settings(run: Run) -> EditSettings:
    """The arm's settings, over what all runs share: the whole picture is edited."""
    base = EditSettings(
        update=UpdateSettings(patches=run.case.patches, patch=run.case.patch),
        held_out_edits=0,
        region="all",
        coverage=1.0,
    )
    base = replace(base, sampler=replace(base.sampler, precision="float32"))
    for name, value in run.arm.settings.items():
        record, _, inner = name.rpartition(".")
        if record:
            value, inner = replace(getattr(base, record), **{inner: value}), record
        base = replace(base, **{inner: value})
    return base


@dataclass(frozen=True)
class _Observed:
    """A strategy that is looked at between its actions."""

    strategy: Strategy
    observer: _Observer

    def schedule(self, session: Session) -> Iterator[Action]:
        self.observer.begin(session)
        for action in self.strategy.schedule(session):
            if session.work.actions:  # not where the schedule is only counted through
                self.observer.look(session)
            yield action
        if session.work.actions:
            self.observer.look(session, due=True)


@dataclass(eq=False)
class _Observer:
    """Measures the scene at held-out cameras; its own time is not the edit's."""

    points: list[Point] = field(default_factory=list)
    truths: Float[Tensor, "k v h w 3"] = field(default_factory=lambda: torch.zeros(0))
    """Pictures that are right, at the held-out cameras."""
    kind: str = EXACT
    views: tuple[int, ...] = ()
    session: Session | None = None
    _clock: Stopwatch = field(default_factory=Stopwatch)
    _spent: float = 0.0
    _next: float = 0.0

    def begin(self, session: Session) -> None:
        """Make the pictures that are right; the clock starts when this ends."""
        self.session = session
        self.views = shown_views(session, MEASURED_VIEWS)
        if not self.views:
            raise UsageError("no view is held out: there is nothing to measure at")
        renderings = [session.unedited_rendering(i) for i in self.views]
        unedited = torch.stack([r.color.clamp(0, 1) for r in renderings])
        if session.request.editor.capabilities.find_ground_truth is not None:
            right = parse(session.request.prompt).variants(unedited)
        else:
            self.kind, right = OWN, _asked(session, self.views)[None]
        # where nothing is shown no Gaussian can follow an edit of the background
        shown = torch.stack([r.alpha for r in renderings])[..., None]
        self.truths = torch.lerp(unedited.expand_as(right), right, shown.expand_as(right))
        self.points, self._spent, self._clock = [], 0.0, Stopwatch()
        self.look(session, due=True)

    def look(self, session: Session, *, due: bool = False) -> None:
        """A point of the curve, if it is due."""
        if not due and session.work.steps < self._next:
            return
        entered = time.monotonic()
        seconds = self._clock.seconds - self._spent
        finals = torch.stack(session.render(session.views[i].camera for i in self.views))
        errors = (self.truths - finals).double().square().mean((1, 2, 3, 4)).sqrt()
        work, editing = session.work, session.stopwatch.stages.get("sample", 0.0)
        self.points.append(
            Point(seconds, editing, work.steps, work.calls, work.evaluations,
                  tuple(errors.tolist()))
        )  # fmt: skip
        self._next = max(work.steps + EVERY, SPARSER * work.steps)
        self._spent += time.monotonic() - entered


def _asked(session: Session, views: Sequence[int]) -> Float[Tensor, "v h w 3"]:
    """What the editor makes of these views together, from the unedited scene; the edit goes on as
    if it had not been asked."""
    generator = torch.Generator().manual_seed(REFERENCE_SEED)
    aside = replace(
        session,
        request=replace(session.request, generator=generator),
        noise_seed=REFERENCE_SEED,
        stopwatch=Stopwatch(),
        work=Work(),
    )
    start = {i: session.unedited_picture(i) for i in views}
    matches, sampler = match_views(session, views), SamplerSettings(precision="float32")
    steps = sample_views(aside, views, (), matches, sampler, start=start, stage=MEASURE)
    return torch.stack(_returned(steps))


def _returned(steps: Any) -> Any:
    """What a generator returns."""
    value = None

    def run() -> Iterator[Any]:
        nonlocal value
        value = yield from steps

    deque(run(), maxlen=0)
    return value


def _record(observer: _Observer, session: Session, result: EditResult) -> Record:
    short = [
        row for row in result.quality.warp if row.pictures == "targets" and row.range == "short"
    ]
    last = observer.points[-1].errors
    truth = observer.truths[last.index(min(last))]
    finals = torch.stack(session.render(session.views[i].camera for i in observer.views))
    targets, originals = (
        [view.image for view in views] for views in (result.targets, result.originals)
    )
    expected, target_error = originals, None
    if observer.kind == EXACT and targets:
        variants = parse(result.prompt).variants(torch.stack(originals))
        squares = (variants - torch.stack(targets)).double().square().mean((1, 2, 3, 4))
        expected = list(variants[int(squares.argmin())])
        target_error = float(squares.min().sqrt())
    return Record(
        curve=tuple(observer.points),
        truth=observer.kind,
        disagreement=short[0].edited if short else None,
        unedited_disagreement=short[0].unedited if short else None,
        matched=result.quality.matched,
        target_error=target_error,
        target_sharpness=_energy(targets) / _energy(expected) if targets else 0.0,
        sharpness=_energy(finals) / _energy(truth),
        strength=result.quality.strength,
        **vars(provenance()),
    )


def _energy(pictures: Sequence[Float[Tensor, "h w 3"]] | Float[Tensor, "v h w 3"]) -> float:
    """Mean squared difference of neighbouring pixels."""
    return sum(
        float(p.double().diff(dim=axis).square().mean()) for p in pictures for axis in (0, 1)
    ) / len(pictures)


def _pictures(observer: _Observer, session: Session) -> list[Float[Tensor, "h w 3"]]:
    """Two unedited views, what the editor made of them (else unedited), a held-out view unedited,
    edited, and as it should be."""
    first = session.surveyed.plan.rounds[0][:2]
    shown = (first * 2)[:2]
    unedited = {i: session.unedited_picture(i) for i in shown}
    targets = {i: view.image for i, view in session.edited.targets.items()}
    last = observer.points[-1].errors
    return [
        *(unedited[i] for i in shown),
        *(targets.get(i, unedited[i]) for i in shown),
        session.unedited_picture(observer.views[0]),
        session.render([session.views[observer.views[0]].camera])[0],
        observer.truths[last.index(min(last))][0],
    ]


def _write_strip(path: Path, pictures: Sequence[Float[Tensor, "h w 3"]]) -> None:
    from gsedit.files.atomic import atomic_path
    from gsedit.files.pictures import as_picture

    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path, overwrite=True) as temporary:
        as_picture(torch.cat(list(pictures), 1)).save(temporary, format="png")
