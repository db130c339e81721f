"""Edit a scene from a sentence: the spine that the command line, the page and Python share."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.editing.grain import drawn, explained
from gsedit.editing.measure import Changed, EditResult, changed_by, measured
from gsedit.editing.painters import Looking, painted
from gsedit.editing.parts import aimed_at, assumed, find_parts
from gsedit.editing.plan import asks_editor_2d, is_exact, key_of, read_steps
from gsedit.errors import Said, UsageError
from gsedit.measures.features import FeatureExtractor
from gsedit.paper.actions import Strategy
from gsedit.paper.draw import EditPlan
from gsedit.paper.editors import make_editor
from gsedit.paper.editors.protocol import Editor, StylePainter, following
from gsedit.paper.request import Method, Request, build_request, check_strategy
from gsedit.paper.settings import EditSettings
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.run.events import Checkpoint, Event
from gsedit.run.state import State
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.outcome import same
from gsedit.select.finder import Finder, Names
from gsedit.select.region import Region
from gsedit.views.around import find_viewpoints
from gsedit.views.viewpoints import Views, viewpoints_of
from gsedit.words.instruction import Instruction
from rasterizer.numerics import under
from rasterizer.scene import Gaussians


def edit(scene: Gaussians, sentence: str, views: Views | None = None, **how: Any) -> EditResult:
    """Edit a scene from a sentence, to the end: the result of `edit_steps`, which says more."""
    last = deque(edit_steps(scene, sentence, views, **how), maxlen=1).pop()
    assert isinstance(last, EditResult)  # checkpoints are whole scenes: none is kept
    return last


def edit_steps(
    scene: Gaussians, sentence: str, views: Views | None = None, **how: Any
) -> Iterator[Event | Checkpoint | EditResult]:
    """Edit a scene; yields events and checkpoints while a 2D editor draws, and last the result.

    The sentence is read (gsedit.words). Changes with an exact route are made on the Gaussians;
    painting styles are drawn by the painter, each in the part that it is said of. `views` are
    photos or cameras; None: some are found. `how`: see `prepare`, which raises UsageError for a
    sentence that is refused; with another `editor`, that draws the whole sentence.
    """
    job = prepare(scene, sentence, views, **how)
    yield from under(job.settings.execution, _steps(job, sentence))


def _steps(job: Job, sentence: str) -> Generator[Event | Checkpoint | EditResult, None, None]:
    watch, finder = Stopwatch(), job.finder
    changed = yield from change_steps(finder, job.steps, job, watch)
    yield measured(finder, changed, sentence, job.steps, job.settings, watch)


def change_steps(
    finder: Finder,
    steps: Sequence[Instruction],
    job: Job | None = None,
    watch: Stopwatch | None = None,
    shown: Bool[Tensor, " n"] | None = None,
) -> Generator[Event | Checkpoint, None, Changed]:
    """Change the finder's scene by steps; all that they are about is found before any change.

    `job` says how a 2D editor draws what is not exact; None: that is refused. What is not `shown`
    (None: all is) may keep its old reflections, as for a preview of one view. Raises UsageError as
    the painters and `find_parts` do.
    """
    watch, scene = watch or Stopwatch(), finder.scene
    steps = aimed_at(steps, finder.region)
    with watch.stage("find"):
        parts = find_parts(steps, finder, job and job.method and job.method.editor, shown)
    looking, total, drawing = Looking(finder.cameras), same(scene), None
    for step in steps:
        if is_exact(step):
            with watch.stage("change"):
                parts, total = painted(step, parts, total, looking)
        elif job is None:
            raise UsageError(f"{step}: this is drawn, and there is nothing to draw it with")
        else:
            request = job.request(total.scene, step, parts.now(key_of(step.changes[0])))
            drawing = yield from drawn(request, job.state_for(step), watch)
            parts, total = parts.after(step.changes[0], drawing), total.then(drawing)
    return changed_by(scene, steps, parts, total, drawing, assumed(steps, finder.names))


def plan_edit(scene: Gaussians, sentence: str, views: Views | None = None, **how: Any) -> EditPlan:
    """Plan what a 2D editor draws first: nothing is edited, one evaluation is measured.

    Raises UsageError as `edit_steps` does.
    """
    job = prepare(scene, sentence, views, **how)
    step = next((each for each in job.steps if not is_exact(each)), None)
    if step is None or job.method is None:
        raise UsageError(f"{sentence}: this is done on the Gaussians, and no view is edited")
    (step,) = aimed_at((step,), job.finder.region)
    parts = find_parts((step,), job.finder, job.method.editor)
    return explained(job.request(scene, step, parts.now(key_of(step.changes[0]))))


@dataclass(frozen=True, eq=False)
class Job:
    """An edit that was read and checked; nothing is changed yet."""

    steps: tuple[Instruction, ...]
    finder: Finder
    views: Views
    settings: EditSettings
    method: Method | None
    """How a 2D editor draws; None where none does."""
    resume: State | None = None

    def state_for(self, step: Instruction) -> State | None:
        """The state from which a drawn step goes on: a checkpoint is of one of them."""
        drawn = [each.text for each in self.steps if not is_exact(each)]
        if self.resume is None or len(drawn) == 1:
            return self.resume
        begun = self.resume.record.get("request", {}).get("instruction")
        wanted = begun if begun in drawn else drawn[0]  # which refuses another edit's
        return self.resume if step.text == wanted else None

    def request(self, scene: Gaussians, step: Instruction, region: Region | None) -> Request:
        """The request to draw a step in a region of the scene as it is then."""
        assert self.method is not None
        method = replace(self.method, editor=following(self.method.editor, step))
        return build_request(scene, step.text, self.views, region, self.settings, method)


def prepare(
    scene: Gaussians,
    sentence: str,
    views: Views | None = None,
    *,
    settings: EditSettings | None = None,
    names: Names | None = None,
    editor: Editor | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
    resume: State | None = None,
    accept_unread: bool = False,
    steps: tuple[Instruction, ...] | None = None,
) -> Job:
    """Read a sentence whose `steps` are not given, and check all; without views, some are searched.

    The `editor` (the painter) draws its painting styles by the strategy (the single pass); one that
    is no painter draws all of it. `names` are those of saved selections, and masks for nouns; with
    `accept_unread` words of which nothing was made do not stop the rest. `resume` is the state of a
    checkpoint of the same edit. Raises UsageError for a sentence that is refused, what only a
    drawing heeds where nothing is drawn, masks that nothing asks for, an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to edit")
    settings, names = settings or EditSettings(), names or Names()
    drawn = editor is not None and not isinstance(editor, StylePainter)
    if steps is None:
        steps = read_steps(sentence, names.saved, drawn=drawn, accept_unread=accept_unread)
    method = None
    if not all(map(is_exact, steps)):
        generator = generator or torch.Generator().manual_seed(0)
        check_strategy(strategy or SinglePass())
        method = Method(editor or make_editor(), strategy or SinglePass(), generator, features)
        for step in steps:
            if not is_exact(step):
                following(method.editor, step)
    elif editor or strategy or features or asks_editor_2d(settings):
        raise UsageError(Said(f"{sentence.strip()!r} asks for nothing that is drawn", "undrawn"))
    if names.masks is not None and drawn:
        raise UsageError(
            "masks find what a sentence names, and a 2D editor gets this one as it is: save what "
            "gsedit.select.masked.find_masked finds, and name it by settings.region"
        )
    views = views or find_viewpoints(scene)
    viewpoints = viewpoints_of(views)
    finder = Finder(scene, viewpoints, settings.region, names)
    return Job(steps, finder, views, settings, method, resume)
