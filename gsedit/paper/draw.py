"""The painter of the paper: a 2D editor draws views of a scene, and the scene is fitted to them.

It prepares the session, runs the strategy and evaluates the result, or only says what that costs,
measured on one evaluation before the edit begins. Its progress is a state that a checkpoint holds.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from itertools import islice
from operator import index
from textwrap import fill
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.strokes import leading_views
from gsedit.errors import Said, UsageError
from gsedit.paper.actions import RollbackAction
from gsedit.paper.edit_views import batch_of, find_ground_truth
from gsedit.paper.editors.protocol import Cost
from gsedit.paper.evaluate import Drawing, evaluate_edit
from gsedit.paper.request import Request, fits_pictures, request_record, uses_all_views
from gsedit.paper.session import Session, UneditedRenders, Work, edit_camera, start_progress
from gsedit.paper.skips import DISABLED, TERMINAL_COLUMNS, Decision, decide_views, one_line, screen
from gsedit.paper.view_plan import ViewPlan, led_plan, plan_views, random_plan, survey, wholeness
from gsedit.run.events import Checkpoint, Event, as_record, events_of, returned
from gsedit.run.json_lines import plain
from gsedit.run.state import State, check_same, restoring, tensor_like
from gsedit.run.stopwatch import Stopwatch, duration
from gsedit.select.region import Region, everything
from gsedit.views.dataset import View

FORMAT = 7
"""Version of an edit's state: raised when older states can no longer be restored."""


def views_state(session: Session) -> State:
    """Everything that asking the 2D editor changes; the tensors are the session's own."""
    edited = session.progress.edited
    tensors = {"generator": session.request.generator.get_state()}
    tensors |= {f"answer.{i}": image for i, image in edited.answers.items()}
    for i, view in edited.targets.items():
        if view.image is not edited.answers.get(i):  # no file holds the same memory twice
            tensors[f"target.{i}"] = view.image
    if edited.region is not None and not edited.region.is_all:
        tensors["region"] = edited.region.inside
    return State(
        {
            "work": asdict(session.progress.work),
            "answers": list(edited.answers),
            "targets": list(edited.targets),
            "pairs": list(edited.pairs),
            "region": None if edited.region is None else edited.region.note,
            "voted": edited.voted,
        },
        tensors,
    )


def session_state(session: Session, views: State | None = None) -> State:
    """Everything that changes during an edit, with the `views` as they are, or were before."""
    progress, views = session.progress, views or views_state(session)
    tensors = {f"optimizer.{name}": each for name, each in progress.optimizer.state().items()}
    return State(
        {
            "edit_format": FORMAT,
            "view_plan": asdict(session.plan),
            "noise_seed": progress.noise_seed,
            "seconds": progress.stopwatch.seconds,
            "stages": dict(progress.stopwatch.stages),
            **views.record,
        },
        tensors | dict(views.tensors),
    )


def check_resumable(state: State, request: Mapping[str, Any]) -> None:
    """Raise UsageError where the state is of another version, or of another `request_record`."""
    if state.record.get("edit_format") != FORMAT:
        what = "the checkpoint of this edit was written by another version of gsedit"
        raise UsageError(Said(what, "begin-again"))
    with restoring(state):
        check_same(request, state.record["request"], "edit")


def view_plan_of(state: State) -> ViewPlan:
    """The plan of views of a state: it is not made again, so that it is certainly the same."""
    with restoring(state):
        plan = state.record["view_plan"]
        batches = tuple(tuple(map(index, batch)) for batch in plan["batches"])
        return ViewPlan(batches, tuple(map(float, plan["coverage"])))


def stopwatch_of(state: State) -> Stopwatch:
    """A stopwatch that goes on from the time that was spent."""
    with restoring(state):
        stages = {name: float(seconds) for name, seconds in state.record["stages"].items()}
        return Stopwatch(state.record["seconds"], stages)


def restore(session: Session, state: State) -> None:
    """Bring a session that has not begun to where the state is."""
    progress, generator = session.progress, session.request.generator
    with restoring(state):
        progress.optimizer.load_state(state.within("optimizer"))
        generator.set_state(tensor_like(state.tensors, "generator", generator.get_state()))
        for name, default in asdict(Work()).items():
            value = state.record["work"][name]
            setattr(progress.work, name, index(value) if type(default) is int else float(value))
        _restore_views(session, state.record, state.tensors)
    if progress.edited.answers:
        find_ground_truth(session, progress.edited.answers)


def _restore_views(
    session: Session, record: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Bring the edited views and the region to where the state is."""
    edited, views = session.progress.edited, session.request.every_view
    edited.answers = {i: _picture(tensors, "answer", i, views) for i in record["answers"]}
    pictures = {
        i: _picture(tensors, "target", i, views) if f"target.{i}" in tensors else edited.answers[i]
        for i in record["targets"]
    }
    edited.targets = {
        i: View(views[i].name, views[i].camera, picture) for i, picture in pictures.items()
    }
    edited.pairs = [(a, b, share) for a, b, share in record["pairs"]]
    edited.voted = record["voted"]
    edited.region = None
    if record["region"] is not None:
        every = everything(session.request.scene).inside
        inside = tensor_like(tensors, "region", every) if "region" in tensors else every
        edited.region = Region(inside, record["region"])


def _picture(
    tensors: Mapping[str, Tensor], name: str, i: int, views: Sequence[View]
) -> Float[Tensor, "h w 3"]:
    """The picture of view i that a checkpoint holds. Raises ValueError for one of another shape."""
    if not 0 <= i < len(views):
        raise ValueError(f"there is no view {i}")
    camera = views[i].camera
    return tensor_like(tensors, f"{name}.{i}", torch.empty(camera.height, camera.width, 3))


@dataclass(frozen=True)
class Estimate:
    """Time and memory of an edit whose views are each edited once."""

    views: int
    """Views that are edited, at most."""
    held_out: int
    """Pictures that the editor is asked for at the end, to compare the scene with: of each view
    two."""
    cost: Cost

    @property
    def seconds(self) -> float:
        """Wall time of the 2D editor; the scene is fitted in seconds."""
        return self.cost.seconds(self.views + self.held_out)

    def describe(self, now: datetime | None = None) -> str:
        """The estimate as one sentence; `now` is when the edit begins."""
        cost, number = self.cost, self.views + self.held_out
        end = (now or datetime.now()) + timedelta(seconds=self.seconds)
        compared = f" ({self.held_out} of them to compare with)" if self.held_out else ""
        branches = cost.evaluations / max(cost.steps, 1)
        parts = [
            f"{number} views{compared}, {cost.steps} steps of {branches:.3g} branches, "
            f"{cost.evaluation_s:.2g} s each in {cost.precision}: about {duration(self.seconds)}, "
            f"until {end:%H:%M}"
        ]
        if cost.peak_bytes:
            parts.append(f"{cost.peak_bytes / 1e9:.1f} GB of memory")
        return "; ".join(parts)


def estimate_edit(session: Session) -> Estimate | None:
    """The estimate of an edit that has not begun, by evaluating the network for the first batch.

    None where the editor does not measure itself, or its views are not edited once each (score
    distillation). The session is left as it was.
    """
    request = session.request
    measure = request.editor.capabilities.measure
    if measure is None or not fits_pictures(request.strategy):
        return None
    plan = session.plan
    cost = measure(batch_of(session, plan.batches[0]), request.settings.sampler)
    held_out = 2 * min(request.settings.held_out_edits, len(request.held_out_indices))
    return Estimate(len(plan.views), held_out, cost)


def draw(
    request: Request, resume: State | None = None
) -> Generator[Event | Checkpoint, None, Drawing]:
    """Edit views of a scene by a 2D editor, and fit the scene to them.

    Yields events, and a checkpoint now and then. Every 8th view is never edited: there the result
    is measured. With the state of a checkpoint, the same edit goes on from there: only later events
    are yielded, the evidence has all. Raises UsageError for the state of another edit.
    """
    record = request_record(request)
    events: list[Event] = []
    if resume is not None:
        check_resumable(resume, record)
        events += events_of(resume)
    work = _run(request, resume)
    while True:
        try:
            item = next(work)
        except StopIteration as ended:
            drawing: Drawing = ended.value
            return replace(drawing, evidence=replace(drawing.evidence, events=tuple(events)))
        if isinstance(item, Event):
            events.append(item)
        else:
            done = events[: len(events) - item.state.record["undone"]]
            recorded = plain([as_record(event) for event in done])
            item = replace(item, state=item.state.along_with(request=record, events=recorded))
        yield item


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


def explain(request: Request) -> EditPlan:
    """Plan an edit: nothing is edited, one evaluation is measured."""
    session = returned(start_session(request))
    return EditPlan(explain_skips(session), estimate_edit(session))


def _run(request: Request, resume: State | None) -> Generator[Event | Checkpoint, None, Drawing]:
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
        drawing = yield from evaluate_edit(session)
    timings = progress.stopwatch.stages | {"total": progress.stopwatch.seconds}
    return replace(
        drawing, evidence=replace(drawing.evidence, decisions=decisions, timings=timings)
    )


def explain_skips(session: Session) -> tuple[Decision, ...]:
    """Every decision of this edit, with its reason, its saving and its error.

    Nothing is decided here that the session does not do already.
    """
    request, plan, settings = session.request, session.plan, session.request.settings
    if not settings.skips("views"):
        return (Decision("views", False, DISABLED),)
    views = decide_views(
        len(plan.views),
        min(settings.most_batches * settings.views_per_batch, len(request.views)),
        plan.coverage[-1],
        settings.coverage,
        needs_all=uses_all_views(request.strategy),
    )
    return (views,)


def start_session(request: Request) -> Generator[Event, None, Session]:
    """The session of a new edit; its optimizer is at the unedited scene."""
    stopwatch = Stopwatch()
    noise_seed = int(torch.randint(1 << 31, (), generator=request.generator))
    session = yield from _session(request, stopwatch, noise_seed)
    region = session.progress.edited.region = request.region
    if region is not None and region.note != "all":
        yield Event("region", stopwatch.seconds, 1, 1, note=str(region))
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
    request, plan, weights = yield from survey_views(request, stopwatch, plan)
    unedited = UneditedRenders(request)
    progress = start_progress(request, stopwatch, noise_seed)
    return Session(request, plan, weights, unedited, progress)


def run_schedule(session: Session) -> Iterator[Event | Checkpoint]:
    """Run the actions of the strategy's schedule that are not done yet, in order.

    Yields a checkpoint between actions when the settings' `checkpoint_seconds` have passed since
    the last one, when asking the 2D editor fails or is interrupted, and at the end.
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
    if work.actions > saved_actions:
        yield checkpoint(session)


def _run_atomically(action: RollbackAction, session: Session) -> Iterator[Event | Checkpoint]:
    """Run an action; on failure, yield a checkpoint of the session as it was."""
    before, events = views_state(session), 0
    try:
        for event in action(session):
            events += 1
            yield event
    except GeneratorExit:
        raise
    except BaseException:  # Ctrl-C too
        if session.progress.work.actions:
            yield checkpoint(session, before, undone=events)
        raise


def checkpoint(session: Session, views: State | None = None, undone: int = 0) -> Checkpoint:
    """A checkpoint of the session, with the `views` as they are, or were before an action that
    failed: its events, the last `undone`, are not done."""
    return Checkpoint(
        session_state(session, views).along_with(undone=undone),
        session.progress.work.steps,
        session.progress.stopwatch.seconds,
        lambda: session.scene.map(torch.clone),
    )


def survey_views(
    request: Request, stopwatch: Stopwatch, plan: ViewPlan | None = None
) -> Generator[Event, None, tuple[Request, ViewPlan, Float[Tensor, "v n"]]]:
    """Plan which views to edit, unless there is a `plan`.

    Returns the request with the views that lead, the plan, and how much each view sees of
    each Gaussian, in pixels of a small picture. Raises UsageError where no view sees the scene.
    """
    views = request.views
    yield Event("survey", stopwatch.seconds, note=f"{len(views)} views")
    with stopwatch.stage("survey"):
        weights = request.seen
        if weights is None:
            weights = survey(request.scene, [view.camera for view in views])
        if request.keeps_strokes and request.leading is None:
            inside = 1.0 if request.region is None else request.region.inside
            leading = leading_views(weights * inside, request.scene.means)
            request = replace(request, leading=leading)
        plan = plan or _plan(request, weights)
    yield Event("survey", stopwatch.seconds, len(views), len(views), note=_note(request, plan))
    return request, plan, weights


def _plan(request: Request, weights: Float[Tensor, "v n"]) -> ViewPlan:
    """The plan of views. Raises UsageError where no view sees the scene."""
    if not weights.any():
        raise UsageError(
            "no camera sees any of the scene: given cameras may not be in the same frame "
            "(without them, some are placed around the scene), or no opacity reaches 1/255"
        )
    settings, cameras = request.settings, [view.camera for view in request.views]
    if settings.view_plan == "random":
        seed, each = request.generator.initial_seed(), settings.views_per_batch
        return random_plan(weights, each, settings.most_batches, seed)
    if settings.skips("views") and request.leading is not None and (request.leading >= 0).any():
        most = settings.most_batches * settings.views_per_batch
        return led_plan(weights, request.leading, settings.views_per_batch, most)
    return plan_views(
        weights,
        settings.views_per_batch,
        settings.most_batches,
        settings.coverage if settings.skips("views") else 1.0,
        overlap=settings.overlap,
        whole=wholeness(request.scene.means, cameras, weights),
    )


def _note(request: Request, plan: ViewPlan) -> str:
    """Views, the size at which they are edited and the number of Gaussians, for a person."""
    note = f"{len(plan.views)} cover {plan.coverage[-1]:.0%} of what all views see"
    camera = request.views[0].camera
    small = edit_camera(camera, request.settings.edit_size)
    if small is not camera:
        note += (
            f"; edited at {small.width}x{small.height} pixels, the change carried to "
            f"{camera.width}x{camera.height}"
        )
    return note
