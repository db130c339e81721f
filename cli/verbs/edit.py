"""`gsedit edit`: change a scene as a sentence says."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gsedit.errors import UsageError

from ..core.checkpoints import NAME, Checkpoints, Resume, load_resume_state, say_threads
from ..core.command import argument, option, output, own_flags, shows
from ..core.console import print_message, print_result
from ..core.features import load_features
from ..core.kernel import UPDATES, say_kernel
from ..core.outputs import check_folder
from ..core.progress import progress, result_of
from ..core.ranks import drain, is_first, ranks
from ..options.cameras import ViewOptions, framed_alike, load_views
from ..options.common import DropInvalid, Force, Scene, Seeded, load_scene
from ..options.edit_checks import check_apart, check_click, check_condition, check_request
from ..options.editing import (
    EditorOptions,
    at_size,
    edit_settings,
    idle_options,
    resolve,
)
from ..options.masks import MaskOptions
from ..options.pointing import AtOptions
from ..options.preview import preview_file, run_preview
from ..options.routes import (
    NO_MASKS,
    OBJECTS,
    carry_beside,
    own_region,
    read_sentence,
    run_routes,
    say_where,
)
from ..options.settings import Setting, SettingsGroup, Values

if TYPE_CHECKING:
    from gsedit.datasets.dataset import Dataset
    from gsedit.editing.edit import EditPlan
    from gsedit.editing.session.result import EditResult
    from gsedit.runs.events import Event
    from gsedit.words.instruction import Instruction as Words

STEPS = "steps"
"""Folder, in that of the edit, with the folders of all edits but the last."""
LEFTOVERS = ("metrics.unfinished.jsonl", "command", STEPS, OBJECTS)
"""Files of an edit that ended before its first checkpoint: alone they need no protection."""

Instruction = Annotated[str, argument("INSTRUCTION", "What should change, as in 'make it snow'.")]


@dataclass(frozen=True)
class EditOptions:
    """Options of `gsedit edit` alone."""

    out: Path | None = output(None, "Folder for the results.")
    explain: bool = option(
        False,
        "Edit nothing: print the work that the edit would skip, why, the largest error that "
        "skipping can cause, and the time and memory that a large 2D model would take.",
    )
    preview: bool = option(
        False, "Edit nothing: draw one view, before and after, into -o FILE.png (preview.png)."
    )
    preset: str = option(
        "default",
        "Values of the options that are not given. quick: half of the evaluations of a 2D model. "
        "paper: Efficient-NeRF2NeRF as printed; gsedit list presets shows all that each sets.",
        "default|quick|paper",
    )
    features: str = option(
        "filters",
        "Features of the Gram loss. filters: a filter bank. vgg: the VGG16 of stlpips_pytorch "
        "(gsedit[perceptual]). FILE: a VGG16 of torchvision, .pth or .safetensors.",
        "filters|vgg|FILE",
    )
    drop_invalid: DropInvalid = False
    force: Force = False
    resume: Resume = False

    @property
    def asks_routes(self) -> bool:
        """Whether nothing here asks for the 2D editor."""
        usual = EditOptions()
        return (self.preset, self.features) == (usual.preset, usual.features)


@dataclass(frozen=True)
class EditCommand:
    """Everything that `gsedit edit` was asked."""

    scene: Path
    """Scene that is edited now."""
    instruction: str
    folder: Path
    """Folder for the results."""
    own: EditOptions
    views: ViewOptions
    editor: EditorOptions
    values: Values
    common: Seeded
    first_scene: Path | None = None
    """Scene before all edits of the sentence, which edit.json names in the place of `scene`."""
    masks: MaskOptions = NO_MASKS
    sized: bool = True
    """Whether the size of the views, where there is one, was asked for."""


@shows(
    "--output", "--data", "--region", "--at", "--editor", "--preview",
    "--size", "--explain", "--resume", "--force", "--seed",
)  # fmt: skip
def edit(
    scene: Scene,
    instruction: Instruction,
    *,
    own: EditOptions,
    views: ViewOptions,
    editor: EditorOptions,
    masks: MaskOptions,
    pointing: AtOptions,
    values: Annotated[Values, SettingsGroup(lambda: all_settings())],
    common: Seeded,
) -> None:
    """Edit a scene from a sentence.

    gsedit edit scene.ply "turn it into a bronze statue" --data photos/ -o out

    The folder gets the edited scene.ply, before_after.png, edit.json (settings, quality, timings)
    and the files that --resume, gsedit metrics and further edits read. SCENE may be such a folder.

    Without --data, the views are renders from the cameras.json beside the scene, or from
    viewpoints that gsedit finds. gsedit list settings edit explains every setting.
    """
    values = pointing.in_place_of_region(values)
    load = partial(load_scene, scene, drop_invalid=own.drop_invalid)
    if own.preview:
        if own.explain or own.resume:
            raise UsageError("--preview writes one picture: leave out --explain and --resume")
        file = preview_file(own.out)
        check_request(instruction, views, file, own.explain)
        common.apply()
        return run_preview(
            scene, load, instruction, file, views, editor, values, common.seed,
            masks=masks, force=own.force, as_json=common.json,
        )  # fmt: skip
    folder = check_request(instruction, views, own.out, own.explain)
    if pointing.at and own.asks_routes and not own.explain:
        check_click(instruction, editor, values, scene)
    request = scene, instruction, folder, own, views, editor, values, common
    result = run_edit(EditCommand(*request, masks=masks))
    if result is not None:
        print_edit(result, folder, as_json=common.json)


def all_settings() -> list[Setting]:
    """Return every setting of an edit and of its strategies."""
    return edit_settings(own_flags(edit))


def run_edit(asked: EditCommand) -> EditResult | None:
    """Edit by the routes that a sentence needs, and write the folder.

    Where they take turns, the last edit is in the folder, the others below it. Returns None on all
    ranks but the first, and where the edit is only explained.
    """
    own = asked.own
    sentence = asked.instruction, asked.editor, asked.values, asked.scene
    steps = read_sentence(*sentence) if own.asks_routes else None
    from gsedit.editing.routes.apply import is_exact

    exact = [is_exact(step) for step in steps or ()]
    if not any(exact):
        asked.masks.check_unused()
    if steps is None:
        return run_pipeline(asked)
    if own.explain and any(exact):
        return print_routes(steps)
    if own.explain or exact == [False]:
        return run_pipeline(asked)
    check_steps(asked.scene, asked.folder, own, len(steps))
    return run_steps(asked, steps)


def run_steps(asked: EditCommand, steps: Sequence[Words]) -> EditResult | None:
    """Do the edits of a sentence, each on the scene of the one before; return the last result."""
    from gsedit.editing.routes.apply import is_exact

    own, scene, result = asked.own, asked.scene, None
    kept = all(each.route != "object" for step in steps[:-1] for each in step.changes)
    more = {"drop_invalid": own.drop_invalid, "preset": own.preset, "features": own.features}
    more |= {"seed": asked.common.seed, "ranks": 1}
    if len(steps) > 1:
        more["sentence"], own = asked.instruction, replace(own, force=True)
    for number, step in enumerate(steps, 1):
        last = number == len(steps)
        out = asked.folder if last else asked.folder / STEPS / str(number)
        if own.resume and not last and (out / "edit.json").exists():
            check_step(out, step, scene)
            scene = out / "scene.ply"
            continue
        if len(steps) > 1:
            print_message(f"edit {number} of {len(steps)}: {step.text}")
        now = replace(asked, scene=scene, instruction=step.text, folder=out, own=own)
        known = own_region(asked.values, asked.scene, scene)
        now = replace(now, values=known, first_scene=asked.scene if last and kept else None)
        if is_exact(step):
            asked.common.apply()
            load = partial(load_scene, scene, drop_invalid=own.drop_invalid)
            named = {**more, "scene": now.first_scene or scene}
            result = run_routes(scene, load, step, out, asked.views, now.values, named, asked.masks)
        else:
            result = run_pipeline(now)
        scene = out / "scene.ply"
    return result


def check_steps(scene: Path, folder: Path, own: EditOptions, number: int) -> None:
    """Raise UsageError where the folder is another's; remove steps of an earlier edit."""
    if number > 1 and ranks().size > 1:
        raise UsageError(f"this takes {number} edits: ranks do one at a time, ask for each alone")
    check_apart(scene, folder)
    begun = own.resume and ((folder / NAME).exists() or (folder / STEPS).is_dir())
    check_folder(folder, own.force or begun, leftovers=LEFTOVERS)
    if not own.resume:
        shutil.rmtree(folder / STEPS, ignore_errors=True)


def check_step(done: Path, step: Words, scene: Path) -> None:
    """Raise UsageError where the edit in a folder of steps is not this one of this scene."""
    from gsedit.formats.edit_records import read_edit_record

    record = read_edit_record(done / "edit.json")
    if record.get("instruction") != step.text or Path(str(record.get("scene"))) != scene:
        raise UsageError(f"{done} holds another edit: start again with -f, or name another folder")


def print_routes(steps: Sequence[Words]) -> None:
    """Print what is done on the Gaussians, where an edit is only explained."""
    print_message(f"{'; '.join(map(str, steps))}: done on the Gaussians, no view is edited")


def run_pipeline(asked: EditCommand) -> EditResult | None:
    """Edit by a 2D editor with progress on the terminal, and write the folder.

    Returns None on all ranks but the first, and where the edit is only explained.
    """
    scene, instruction, folder, own = asked.scene, asked.instruction, asked.folder, asked.own
    views, values, common, editor = asked.views, asked.values, asked.common, asked.editor.settled()
    kept = {"editor": replace(editor, yes=False), "features": own.features}
    state = None
    if not own.explain:
        check_apart(scene, folder)
        state = load_resume_state(folder / NAME, kept, "edit", resume=own.resume, force=own.force)
        check_folder(folder, own.force or state is not None, leftovers=LEFTOVERS)
    common.apply()
    say_threads(state)

    from gsedit.editing.edit import edit_steps, plan_edit
    from gsedit.editing.session.folder import history_of
    from gsedit.editing.session.strategy import asks_editor, check_strategy
    from gsedit.runs.events import events_of

    settings, strategy = resolve(own.preset, values, own_flags(edit))
    check_strategy(strategy)
    if idle := idle_options(values, settings, own_flags(edit)):
        print_message(f"{', '.join(idle)}: no effect where colors are solved for (--loss mse)")
    check_condition(settings.condition, views.data)
    followed = instruction if asks_editor(strategy) else None
    editor_2d = editor.make(folder, followed, settings.sampler.precision)
    settings = at_size(settings, editor_2d, views.size if asked.sized else None)
    extractor = load_features(own.features)
    if own.preset == "paper" and own.features == "filters":
        print_message("a filter bank stands in for VGG's features, see --features")
    gaussians = load_scene(scene, drop_invalid=own.drop_invalid)
    say_kernel(settings.execution, UPDATES)
    dataset = framed_alike(load_views(scene, gaussians, views, settings.execution))
    library_request = {
        "dataset": dataset, "editor": editor_2d, "settings": settings, "strategy": strategy,
        "features": extractor, "generator": common.generator(),
    }  # fmt: skip
    if own.explain:
        plan = plan_edit(gaussians, instruction, **library_request)
        return print_plan(plan, as_json=common.json)
    steps = edit_steps(gaussians, instruction, **library_request, resume=state, ranks=ranks())
    if not is_first():
        return drain(steps)
    request = {
        "scene": asked.first_scene or scene, "drop_invalid": own.drop_invalid, **asdict(views),
        "size": views.pixels, "editor": kept["editor"], "preset": own.preset,
        "features": own.features, "seed": common.seed,
        "ranks": ranks().size, **history_of(scene),
    }  # fmt: skip
    earlier = [] if state is None else events_of(state)
    source = {"scene": scene.absolute(), "drop_invalid": own.drop_invalid}
    check = partial(check_folder, folder, own.force or state is not None, leftovers=LEFTOVERS)
    checkpoints = Checkpoints(folder / NAME, kept, source, check)
    carry = partial(carry_beside, scene, gaussians)
    return run_and_write(
        steps, folder, dataset, request, checkpoints, earlier, carry, as_json=common.json
    )


def print_edit(result: EditResult, folder: Path, *, as_json: bool) -> None:
    """Print the place of the edited scene."""
    record = {
        "folder": folder,
        "scene": folder / "scene.ply",
        "ground_truth": result.metrics.psnr_to_ground_truth,
        "psnr_outside_region": result.metrics.psnr_outside_region,
    }
    print_result(record, str(folder / "scene.ply"), as_json=as_json)


def write_cameras_and_views(dataset: Dataset, result: EditResult, folder: Path) -> None:
    """Write the cameras that other commands read, and the views that gsedit metrics measures."""
    from gsedit.datasets.cameras_json import write_cameras
    from gsedit.datasets.view_list_files import by_edit, write_view_list
    from gsedit.datasets.viewpoints import viewpoints_of

    views = by_edit(viewpoints_of(dataset), {view.name for view in result.originals})
    write_cameras(dataset.views, folder / "cameras.json", overwrite=True)
    write_view_list(views, folder / "views.json", overwrite=True)


def print_plan(plan: EditPlan, *, as_json: bool) -> None:
    """Print the work that an edit would skip, and what it would take."""
    print_result(plan._asdict(), plan.describe(), as_json=as_json)


def run_and_write(
    steps: Iterable[Any],
    out: Path,
    dataset: Dataset,
    request: Mapping[str, Any],
    checkpoints: Checkpoints,
    earlier: Iterable[Event],
    carry: Callable[[EditResult, Path], None],
    *,
    as_json: bool,
) -> EditResult:
    """Run an edit, show its events, and write its result to the folder `out`.

    Until then the folder holds the last checkpoint and the events so far, which begin with the
    `earlier` ones of a resumed edit. `carry` writes what else belongs beside the result.
    """
    from gsedit.editing.session.folder import write_edit
    from gsedit.measures.against import UNFINISHED
    from gsedit.pictures.stage_table import table
    from gsedit.runs.events import Checkpoint, Event
    from gsedit.runs.journal import event_journal

    with checkpoints:
        journal = event_journal(out / UNFINISHED, earlier)
        with progress(as_json=as_json) as show:

            def write_and_show(event: Event) -> None:
                with suppress(OSError):  # a full disk; the result lists all events
                    journal.write(event)
                show(event)

            handlers = {Event: write_and_show, Checkpoint: checkpoints.keep}
            result = result_of(steps, handlers)
        write_cameras_and_views(dataset, result, out)
        carry(result, out)
        write_edit(out, result, request=request, overwrite=True)
    print_message(table(journal.records))
    print_message(result.metrics.describe())
    say_where(out)
    return result
