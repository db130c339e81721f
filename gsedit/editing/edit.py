"""Edit a scene from a sentence: prepare the session, run the strategy, evaluate the result."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import islice
from textwrap import fill
from typing import Any, NamedTuple

import torch

from gsedit.datasets.dataset import Dataset
from gsedit.editing.estimate import Estimate, estimate_edit
from gsedit.editing.session.actions import RollbackAction, Strategy
from gsedit.editing.session.choose_region import choose_region
from gsedit.editing.session.evaluate import evaluate_edit
from gsedit.editing.session.progress import start_progress
from gsedit.editing.session.request import Request, build_request, request_record
from gsedit.editing.session.result import EditResult
from gsedit.editing.session.session import Session
from gsedit.editing.session.settings import EditSettings
from gsedit.editing.session.state import (
    SessionSnapshot,
    check_resumable,
    restore,
    session_state,
    stopwatch_of,
    view_plan_of,
)
from gsedit.editing.session.strategy import name_of
from gsedit.editing.session.survey import survey_views
from gsedit.editing.session.unedited import UneditedRenders
from gsedit.editing.skip.decide import explain_skips
from gsedit.editing.skip.decision import TERMINAL_COLUMNS, Decision, one_line, screen
from gsedit.editing.strategies.single_pass import SinglePass
from gsedit.editing.view_plan import ViewPlan
from gsedit.editor_protocol import Editor
from gsedit.editors import make_editor
from gsedit.measures.features import FeatureExtractor
from gsedit.runs.events import Checkpoint, Event, events_of, returned
from gsedit.runs.journal import as_record
from gsedit.runs.json_lines import plain
from gsedit.runs.ranks import ALONE, Ranks
from gsedit.runs.state import State
from gsedit.runs.stopwatch import Stopwatch
from rasterizer.scene import Gaussians


def edit_steps(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor,
    generator: torch.Generator,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    resume: State | None = None,
    ranks: Ranks = ALONE,
) -> Iterator[Event | Checkpoint | EditResult]:
    """Edit a scene; yields events, a checkpoint now and then, and last the result.

    Without a dataset, views are found (gsedit.cameras.around); views of several sizes are framed in
    the most frequent one. Every 8th view is never edited: there the result is measured. `strategy`
    defaults to the single pass, `features` (of the Gram loss) to a bank of oriented filters. With
    the state of a checkpoint, the same edit goes on from there: only later events are yielded, the
    result has all. Every one of several `ranks` is given the same and yields the same. Raises
    UsageError for an instruction the editor cannot follow, an empty scene, a strategy that is no
    dataclass, or the state of another edit.
    """
    strategy = strategy or SinglePass()
    given = {"dataset": dataset, "settings": settings, "features": features, "ranks": ranks}
    request = build_request(scene, prompt, editor, generator, strategy, **given)
    record = request_record(request)
    ranks.check_same("the request", [record])
    if resume is not None:
        check_resumable(resume, record)
    yield from _recorded(_run(request, resume), record, resume)


class EditPlan(NamedTuple):
    """The plan of an edit: work that is skipped, time and memory."""

    decisions: tuple[Decision, ...]
    """The work that it would skip, and why."""
    estimate: Estimate | None
    """Its time and memory; None where the editor takes little, or cannot be measured."""

    def describe(self) -> str:
        """Both as lines for a terminal."""
        lines = screen(self.decisions)
        if self.estimate is None:
            return lines
        return f"{lines}\n{fill(f'estimate: {self.estimate.describe()}', TERMINAL_COLUMNS)}"


def plan_edit(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor | None = None,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
) -> EditPlan:
    """Plan an edit: nothing is edited, one evaluation is measured. Raises as `edit_steps` does."""
    request = build_request(
        scene, prompt, editor or make_editor(), generator or torch.Generator().manual_seed(0),
        strategy or SinglePass(), dataset=dataset, settings=settings, features=features,
    )  # fmt: skip
    session = returned(start_session(request))
    return EditPlan(explain_skips(session), estimate_edit(session))


def _run(
    request: Request, resume: State | None
) -> Generator[Event | Checkpoint | EditResult, None, None]:
    """Prepare the session, run the strategy's actions, and evaluate the result."""
    if resume is None:
        session = yield from start_session(request)
    else:
        session = resume_session(request, resume)
    decisions, progress = explain_skips(session), session.progress
    if resume is None:
        yield Event("skip", progress.stopwatch.seconds, note=one_line(decisions))
        if estimate := estimate_edit(session):
            progress.work.evaluations += estimate.cost.spent
            yield Event("estimate", progress.stopwatch.seconds, note=estimate.describe())
    yield from run_schedule(session)
    with progress.stopwatch.stage("measure"):
        evaluated = yield from evaluate_edit(session)
    yield evaluated.final.event("measure", progress.stopwatch.seconds)
    yield EditResult(
        prompt=request.prompt,
        scene=evaluated.scene,
        originals=evaluated.originals,
        targets=tuple(progress.edited.targets.values()),
        finals=evaluated.finals,
        settings=request.settings,
        strategy=request.strategy,
        strategy_name=name_of(request.strategy),
        view_plan=session.surveyed.plan,
        region=evaluated.region,
        metrics=evaluated.metrics,
        work=progress.work,
        decisions=decisions,
        timings=progress.stopwatch.stages | {"total": progress.stopwatch.seconds},
        held_out=evaluated.held_out,
    )


def _recorded(
    items: Iterator[Event | Checkpoint | EditResult],
    request: dict[str, Any],
    resume: State | None,
) -> Iterator[Event | Checkpoint | EditResult]:
    """The items of an edit; checkpoints and the result get all events so far."""
    events: list[Event] = []
    if resume is not None:
        events += events_of(resume)
    for item in items:
        match item:
            case Event():
                events.append(item)
            case Checkpoint(state):
                done = events[: len(events) - state.record["undone"]]
                recorded = plain([as_record(event) for event in done])
                item = replace(item, state=state.along_with(request=request, events=recorded))
            case EditResult():
                item = replace(item, events=tuple(events))
        yield item


def start_session(request: Request) -> Generator[Event, None, Session]:
    """The session of a new edit; its optimizer is at the unedited scene."""
    stopwatch = Stopwatch()
    noise_seed = int(torch.randint(1 << 31, (), generator=request.generator))
    session = yield from _session(request, stopwatch, noise_seed)
    session.progress.edited.region = yield from choose_region(session.request, stopwatch)
    return session


def resume_session(request: Request, state: State) -> Session:
    """The session of an interrupted edit, which goes on from the state."""
    watch, noise_seed = stopwatch_of(state), state.record["noise_seed"]
    session = returned(_session(request, watch, noise_seed, view_plan_of(state)))
    restore(session, state)
    return session


def _session(
    request: Request, stopwatch: Stopwatch, noise_seed: int, plan: ViewPlan | None = None
) -> Generator[Event, None, Session]:
    """A session that has not begun, of a request whose views are surveyed."""
    request, surveyed = yield from survey_views(request, stopwatch, plan)
    unedited = UneditedRenders(request, surveyed.renderings)
    progress = start_progress(request, surveyed, unedited, stopwatch, noise_seed)
    return Session(request, surveyed, unedited, progress)


def run_schedule(session: Session) -> Iterator[Event | Checkpoint]:
    """Run the actions of the strategy's schedule that are not done yet, in order.

    Yields a checkpoint between actions when the settings' `checkpoint_seconds` have passed since
    the last one, when asking the 2D editor fails or is interrupted, and at the end. Raises
    GseditError where ranks no longer take the same decisions.
    """
    request, work, stopwatch = session.request, session.progress.work, session.progress.stopwatch
    saved_seconds, saved_actions = stopwatch.seconds, work.actions
    for action in islice(request.strategy.schedule(session), work.actions, None):
        due = stopwatch.seconds - saved_seconds >= request.settings.checkpoint_seconds
        if due and work.actions > saved_actions:
            saved_seconds, saved_actions = stopwatch.seconds, work.actions
            yield checkpoint(session)
        is_atomic = isinstance(action, RollbackAction)
        yield from _run_atomically(action, session) if is_atomic else action(session)
        work.actions += 1
        request.ranks.check_same("the work", (work, request.generator.get_state()))
    if work.actions > saved_actions:
        yield checkpoint(session)


def _run_atomically(action: RollbackAction, session: Session) -> Iterator[Event | Checkpoint]:
    """Run an action; on failure, restore the session and yield a checkpoint of it as it was."""
    snapshot, events = SessionSnapshot(session), 0
    try:
        for event in action(session):
            events += 1
            yield event
    except GeneratorExit:
        raise
    except BaseException:  # Ctrl-C too
        snapshot.restore(session)
        if session.progress.work.actions:
            yield checkpoint(session, undone=events)
        raise


def checkpoint(session: Session, undone: int = 0) -> Checkpoint:
    """A checkpoint of the session; the last `undone` events belong to an action rolled back."""
    return Checkpoint(
        session_state(session).along_with(undone=undone),
        session.progress.work.steps,
        session.progress.stopwatch.seconds,
        session.whole_scene,
    )
