"""The pipeline of an edit: survey the views, run a strategy, measure what came out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from dataclasses import is_dataclass, replace
from functools import partial
from typing import Any, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors import make_editor
from gsedit.editors.protocol import Editor
from gsedit.editors.ranked import with_ranks
from gsedit.errors import UsageError
from gsedit.files.state import State, check_same
from gsedit.fitting.edit_loss import check_installed
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.fitting.update import rates
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.ranks import ALONE, Ranks
from gsedit.regions.region import Region
from gsedit.reports.events import Checkpoint, Event
from gsedit.reports.journal import as_record
from gsedit.reports.json_lines import plain
from gsedit.reports.stopwatch import Stopwatch
from gsedit.savings.decision import Decision, one_line
from gsedit.session import choose_region as regions
from gsedit.session.decisions import decide
from gsedit.session.evidence import gather_evidence
from gsedit.session.result import EditResult
from gsedit.session.run import run_schedule
from gsedit.session.session import EditedViews, Request, Session, SurveyedViews, survey_views
from gsedit.session.settings import EditSettings
from gsedit.session.state import planned, requested, restore, stopwatch_of
from gsedit.strategies import (
    DEFAULT,
    Strategy,
    asks_editor,
    check_strategy,
    find_strategy,
    fits_pictures,
    name_of,
    uses_all_views,
)
from gsedit.views.choose import find_views, view_names
from gsedit.views.coarse import Coarse, coarsen
from gsedit.views.dataset import Dataset, View, capture
from gsedit.views.framing import bounds
from gsedit.views.kept import of_one_size
from gsedit.views.search import Wish
from rasterizer.blending.choose import is_compiled
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

Returned = TypeVar("Returned")

FOUND_VIEWS = 24
"""Views of a scene that came without cameras."""
FOUND_SIZE = 256


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
    """Edit a scene; yields what happens, a checkpoint now and then, and last the result.

    Without a dataset, views are found (`around`); views of several sizes are framed in the most
    frequent one. Every 8th view is never edited: there the result is measured. `strategy` defaults
    to the single pass, `features` (of the Gram loss) to a bank of oriented filters. With the state
    of a checkpoint, the same edit goes on from there: only what happens after it is yielded, the
    result has all. Every one of several `ranks` is given the same and yields the same. Raises
    UsageError for an instruction the editor cannot follow, an empty scene, a strategy that is no
    dataclass, or the state of another edit.
    """
    editor = with_ranks(editor, ranks)
    request, strategy = _asked(
        scene, prompt, editor, generator, dataset, settings, strategy, features
    )
    request = replace(request, ranks=ranks)
    asked = partial(requested, request, strategy, name_of(strategy))
    if ranks.size > 1:
        ranks.check_same("the request", [asked()])
    yield from _recorded(_run(request, strategy, resume), asked, resume)


def explain(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor | None = None,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
) -> tuple[Decision, ...]:
    """What `edit` would leave out, and why. Nothing is edited. Raises what `edit_steps` raises."""
    editor, generator = editor or make_editor(), generator or torch.Generator().manual_seed(0)
    request, strategy = _asked(
        scene, prompt, editor, generator, dataset, settings, strategy, features
    )
    session = _ended(_begin(request))
    return decide(session, strategy.schedule(session))


def edit(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor | None = None,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
) -> EditResult:
    """`edit_steps` to the end, with the editor `small` if none is given."""
    steps = edit_steps(
        scene,
        prompt,
        editor=editor or make_editor(),
        generator=generator or torch.Generator().manual_seed(0),
        dataset=dataset,
        settings=settings,
        strategy=strategy,
        features=features,
    )
    last = deque(steps, maxlen=1).pop()  # checkpoints are whole scenes: none is kept
    assert isinstance(last, EditResult)
    return last


def around(
    scene: Gaussians,
    size: int = FOUND_SIZE,
    up: Float[Tensor, "3"] | None = None,
    *,
    look_at: Float[Tensor, "3"] | None = None,
    eye: Float[Tensor, "3"] | None = None,
    execution: Execution = AUTO,
) -> Dataset:
    """Renders of a scene that came without photos, `size` pixels square, from where it looks as if
    it was captured (docs/viewpoints.md).

    `up` (any length), the point `look_at` that views look at and the point `eye` that they are
    taken from are found where they are None. World axes. Raises UsageError for an `up` of no
    direction, or an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to see")
    if up is not None and not (up.isfinite().all() and up.any()):
        raise UsageError(f"up {up.tolist()} is no direction: three finite numbers, not all 0")
    wish = Wish(up, look_at, eye)
    coarse = coarsen(scene)
    looked_at = scene if coarse is None else coarse.scene
    cameras = find_views(looked_at, FOUND_VIEWS, size, wish=wish, execution=execution)
    return Dataset(capture(scene.detach(), cameras, view_names(len(cameras)), execution))


def find_region(
    scene: Gaussians,
    region: str,
    *,
    dataset: Dataset | None = None,
    editor: Editor | None = None,
    prompt: str = "",
    execution: Execution = AUTO,
) -> Region:
    """Where an edit with that `--region` belongs, found as `edit` finds it, before any edit.

    `auto` needs the instruction, and the editor (None: `small`). Raises UsageError where that
    editor predicts no subject, where the region is empty, or for a text that names no region;
    InputError for a file that does not fit.
    """
    views, held_out = _parts(dataset or around(scene, execution=execution))
    editor = editor or make_editor()
    found = regions.find_region(region, scene.detach(), views, held_out, editor, prompt, execution)
    if found is None:
        raise UsageError(
            f"the {editor.name} editor does not say where its subject is before it edits: "
            "gsedit edit finds it from the edited views, and writes region.npy"
        )
    return found


def _follows(editor: Editor, prompt: str) -> bool:
    """Whether the editor could follow the instruction."""
    try:
        editor.check(prompt)
    except UsageError:
        return False
    return True


def _asked(
    scene: Gaussians,
    prompt: str,
    editor: Editor,
    generator: torch.Generator,
    dataset: Dataset | None,
    settings: EditSettings | None,
    strategy: Strategy | None,
    features: FeatureExtractor | None,
) -> tuple[Request, Strategy]:
    """What is to be done, with every default filled in. Raises what `edit_steps` raises."""
    settings, strategy = settings or EditSettings(), strategy or find_strategy(DEFAULT)()
    if isinstance(strategy, type) or not is_dataclass(strategy):
        raise UsageError(
            f"{strategy!r} is no strategy: give an instance of a dataclass, as in SinglePass()"
        )
    check_strategy(strategy)
    if asks_editor(strategy):
        editor.check(prompt)
    elif settings.region == "auto" and not _follows(editor, prompt):
        settings = replace(settings, region="all")  # nobody can say where it belongs
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to edit")
    # the result records the values in force
    declared = editor.capabilities
    settings = replace(
        settings,
        sampler=settings.sampler.with_defaults(declared.defaults),
        edit_size=settings.edit_size or declared.best_size,
    )
    check_installed(settings.update)
    views, held_out = _parts(dataset or around(scene, execution=settings.execution))
    coarse = _cells(scene.detach(), settings, strategy)
    request = Request(
        coarse.scene if coarse else scene.detach(), prompt, views, held_out, editor, settings,
        features or FilterBank(), generator, coarse, uses_all_views(strategy),
    )  # fmt: skip
    return request, strategy


def _cells(scene: Gaussians, settings: EditSettings, strategy: Strategy) -> Coarse | None:
    """The cells that a large scene is edited by; None where its Gaussians are."""
    by_cells = settings.geometry == "appearance" and settings.leaves_out("cells")
    return coarsen(scene) if by_cells and fits_pictures(strategy) else None


def _parts(dataset: Dataset) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """The dataset's split, all of one size; of a single view, which would be held out, that one to
    be edited."""
    views, held_out = of_one_size(dataset).split()
    return (views, held_out) if views else (held_out, ())


def _recorded(
    items: Iterator[Event | Checkpoint | EditResult],
    asked: Callable[[], dict[str, Any]],
    resume: State | None,
) -> Iterator[Event | Checkpoint | EditResult]:
    """The items of an edit, and in checkpoints and the result all events so far.

    Raises UsageError where the edit to resume was `asked` for otherwise.
    """
    events: list[Event] = []
    request = None
    if resume is not None:
        request = plain(asked())
        check_same(request, resume.record["request"], "edit")
        events += [Event(**record) for record in resume.record["events"]]
    for item in items:
        match item:
            case Event():
                events.append(item)
            case Checkpoint(state):
                request = request or plain(asked())
                done = events[: len(events) - state.record["undone"]]
                recorded = plain([as_record(event) for event in done])
                item = replace(item, state=state.along_with(request=request, events=recorded))
            case EditResult():
                item = replace(item, events=tuple(events))
        yield item


def _run(
    request: Request, strategy: Strategy, resume: State | None
) -> Iterator[Event | Checkpoint | EditResult]:
    """The edit, after everything that can be refused was checked."""
    if resume is None:
        advice = request.editor.capabilities.advice
        note = advice(request.prompt) if asks_editor(strategy) else ""
        if note:
            yield Event("advice", 0.0, note=note)
        session = yield from _begin(request)
    else:
        session = _resumed(request, resume)
    decisions = decide(session, strategy.schedule(session))
    if decisions and resume is None:
        yield Event("plan", session.stopwatch.seconds, note=one_line(decisions))
    yield from run_schedule(session, strategy.schedule(session))
    yield from _finish(session, strategy, decisions)


def _begin(request: Request) -> Generator[Event, None, Session]:
    """Survey the views; the optimiser starts from the unedited scene."""
    stopwatch = Stopwatch()
    noise_seed = int(torch.randint(1 << 31, (), generator=request.generator))
    request, surveyed = yield from survey_views(request, stopwatch)
    edited = EditedViews(region=(yield from regions.choose_region(request, stopwatch)))
    return _session(request, surveyed, edited, stopwatch, noise_seed)


def _resumed(request: Request, state: State) -> Session:
    """The session of an interrupted edit: what it sees of the unedited scene is found again."""
    stopwatch, noise_seed = stopwatch_of(state), state.record["noise_seed"]
    request, surveyed = _ended(survey_views(request, stopwatch, planned(state)))
    session = _session(request, surveyed, EditedViews(), stopwatch, noise_seed)
    restore(session, state)
    return session


def _ended(steps: Generator[Any, None, Returned]) -> Returned:
    """What a generator returns; its items are left aside."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _session(
    request: Request,
    surveyed: SurveyedViews,
    edited: EditedViews,
    stopwatch: Stopwatch,
    noise_seed: int,
) -> Session:
    """Its optimiser is at the unedited scene."""
    settings, radius = request.settings, bounds(request.scene).radius
    moving = rates(settings.geometry, radius, hold_all=not settings.leaves_out("geometry"))
    optimiser = SceneOptimiser(
        request.scene,
        moving,
        settings.update.anchor_weight,
        compiled=is_compiled(settings.execution),
    )
    renderings = dict(surveyed.renderings)
    return Session(request, surveyed, renderings, edited, optimiser, stopwatch, noise_seed)


def _of_all(region: Region, coarse: Coarse | None) -> Region:
    """The region of cells as that of all Gaussians."""
    if coarse is None:
        return region
    return replace(region, inside=coarse.expand(region.inside))


def _finish(
    session: Session, strategy: Strategy, decisions: tuple[Decision, ...]
) -> Iterator[Event | EditResult]:
    """Measure the edited scene and hand everything over."""
    with session.stopwatch.stage("measure"):
        evidence = yield from gather_evidence(session)
    yield evidence.final.event("measure", session.stopwatch.seconds)
    yield EditResult(
        prompt=session.request.prompt,
        scene=session.whole_scene,
        originals=evidence.originals,
        targets=tuple(session.edited.targets.values()),
        finals=evidence.finals,
        settings=session.settings,
        strategy=strategy,
        strategy_name=name_of(strategy),
        plan=session.surveyed.plan,
        region=_of_all(session.region, session.request.coarse),
        quality=evidence.quality,
        work=session.work,
        decisions=decisions,
        timings=session.stopwatch.stages | {"total": session.stopwatch.seconds},
        held_out=evidence.held_out,
    )
