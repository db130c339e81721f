"""The result of an edit on the Gaussians themselves, as that of any other edit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Bool
from torch import Tensor

from gsedit.datasets.dataset import View, capture, evenly_spaced
from gsedit.datasets.view_list_files import HELD_OUT_EVERY, ViewList
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.editing.routes.apply import Routed, apply_instruction
from gsedit.editing.routes.named import taken_nouns
from gsedit.editing.routes.objects import MADE
from gsedit.editing.routes.rivals import check_alone
from gsedit.editing.session.progress import Work
from gsedit.editing.session.result import EditMetrics, EditResult, HeldOutViews
from gsedit.editing.session.settings import EditSettings
from gsedit.editing.view_plan import ViewPlan
from gsedit.measures.evaluation import evaluate
from gsedit.measures.evaluation_input import EvaluationInput
from gsedit.runs.stopwatch import Stopwatch
from gsedit.select.finder import Finder, Names
from gsedit.words.instruction import Change, Instruction
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

NAME = "routes"
"""Name of the strategy in edit.json: no view is edited."""
SHOWN_VIEWS = 4
"""Held-out views at which such an edit is measured and shown."""
FINDS_SUBJECT = "auto"
"""Value of the setting `region` that leaves the part to the sentence."""


LEAST_RMSE = 0.005
"""RMSE to the unedited views below which the user is told that hardly anything changed: painting a
subject of one pixel in a hundred makes six times as much."""
MEASURED = ("rmse_to_unedited", "rmse_outside_region", "psnr_outside_region")
"""Metrics of such an edit: the other ones compare with pictures of a 2D editor."""
HARDLY = "hardly anything changed: the scene has little that this acts on"


def change_scene(
    scene: Gaussians,
    instruction: Instruction,
    viewpoints: Sequence[Viewpoint],
    settings: EditSettings | None = None,
    shown: Bool[Tensor, " n"] | None = None,
    names: Names | None = None,
    finder: Finder | None = None,
) -> Routed:
    """The scene with an instruction's changes, in the region that the settings name, if they do;
    `shown` as in `apply_instruction`; phrases may have these `names`.

    A `finder` of the scene, with the same views, region and names, keeps what it found before.
    Raises UsageError as `apply_instruction`, `Finder.select` and `check_alone` do.
    """
    settings = settings or EditSettings()
    finder = finder or Finder(scene, viewpoints, settings.region, names, settings.execution)
    names = finder.names
    if settings.region != FINDS_SUBJECT:
        instruction = replace(instruction, changes=in_region(instruction.changes))
    for noun in taken_nouns(instruction.changes, names):
        check_alone(noun, finder.segments, finder.subject)
    routed = apply_instruction(
        scene, instruction, lambda _: finder.subject, finder.cameras, settings.execution, shown,
        lambda _, phrase: finder.named(phrase), names,
    )  # fmt: skip
    return replace(routed, notes=(*assumed(instruction, settings, names), *routed.notes))


def assumed(instruction: Instruction, settings: EditSettings, names: Names) -> tuple[str, ...]:
    """Remarks on nouns that nobody knows and that are taken for the main subject."""
    if settings.region != FINDS_SUBJECT:
        return ()
    nouns = taken_nouns(instruction.changes, names)
    return tuple(f"{noun!r} was taken for the main subject" for noun in nouns)


def in_region(changes: Sequence[Change]) -> tuple[Change, ...]:
    """Changes of what a region holds, whatever the sentence calls it; all but it where they are of
    the background. Files that are put in, and copies, keep their names."""
    made = {MADE, *(each.phrase for each in changes if each.name == "insert")}
    return tuple(
        each
        if each.phrase in made
        else replace(each, phrase="")
        if each.target == "background" and each.route == "object"
        else replace(each, phrase="", target="subject")
        for each in changes
    )


def routed_result(
    scene: Gaussians,
    instruction: Instruction,
    viewpoints: Sequence[Viewpoint],
    settings: EditSettings | None = None,
    stopwatch: Stopwatch | None = None,
    names: Names | None = None,
) -> EditResult:
    """Change a scene on its Gaussians; measured at some of the views that an edit holds out.

    Raises UsageError as `change_scene` does.
    """
    watch, settings = stopwatch or Stopwatch(), settings or EditSettings()
    with watch.stage("change"):
        routed = change_scene(scene, instruction, viewpoints, settings, names=names)
    with watch.stage("measure"):
        shown = held_out(viewpoints)
        before = pictures_at(scene, shown, settings.execution)
        after = pictures_at(routed.scene, shown, settings.execution)
        metrics = measured(scene, routed, before, after, settings.execution)
    is_seen = (metrics.rmse_to_unedited or 0.0) > LEAST_RMSE
    return EditResult(
        prompt=instruction.text,
        scene=routed.scene,
        originals=(),
        targets=(),
        finals=(),
        settings=settings,
        strategy=None,
        strategy_name=NAME,
        view_plan=ViewPlan((), ()),
        region=routed.region,
        region_before=routed.before,
        origin=routed.origin,
        metrics=metrics,
        work=Work(),
        timings={**watch.stages, "total": watch.seconds},
        held_out=HeldOutViews(before, (), after),
        understood=instruction,
        notes=(*routed.notes, *(() if is_seen else (HARDLY,))),
    )


def held_out(viewpoints: Sequence[Viewpoint]) -> tuple[Viewpoint, ...]:
    """Some of the views that an edit holds out."""
    every = viewpoints[::HELD_OUT_EVERY]
    return tuple(every[i] for i in evenly_spaced(len(every), SHOWN_VIEWS))


def pictures_at(
    scene: Gaussians, viewpoints: Sequence[Viewpoint], execution: Execution = AUTO
) -> tuple[View, ...]:
    """Renders of a scene as views."""
    cameras, names = [each.camera for each in viewpoints], [each.name for each in viewpoints]
    return tuple(capture(scene, cameras, names, execution))


def measured(
    scene: Gaussians,
    routed: Routed,
    before: Sequence[View],
    after: Sequence[View],
    execution: Execution = AUTO,
) -> EditMetrics:
    """The difference of held-out views, and how well what is outside the region is kept."""
    moved = routed.before is not None
    viewpoints = tuple(Viewpoint(each.name, each.camera) for each in before)
    return EditMetrics(
        evaluate(
            EvaluationInput(
                routed.scene,
                ViewList(viewpoints, ("held_out",) * len(before)),
                unedited=scene,
                region=routed.before if moved else routed.region,
                edited_region=routed.region if moved else None,
                finals={i: each.image for i, each in enumerate(after)},
                originals={i: each.image for i, each in enumerate(before)},
                execution=execution,
            ),
            only=MEASURED,
        )
    )
