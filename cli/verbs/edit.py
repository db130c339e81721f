"""`gsedit edit`: change a scene as a sentence says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
from ..core.kernel import RENDERS, UPDATES, say_kernel
from ..core.outputs import check_folder
from ..core.progress import progress, result_of
from ..core.ranks import drain, is_first, ranks
from ..options.cameras import ViewOptions
from ..options.common import DropInvalid, Force, Scene, Seeded, load_scene
from ..options.editing import AUTO, EditorOptions, at_size, edit_settings, idle_options, resolve
from ..options.masks import MaskOptions
from ..options.pointing import AtOptions
from ..options.preview import preview_file, run_preview
from ..options.routes import (
    NO_MASKS,
    OBJECTS,
    asks_editor,
    carry_beside,
    check_apart,
    check_condition,
    check_request,
    names_of,
    numbered,
    read_sentence,
    say_found,
    say_where,
    views_of,
)
from ..options.settings import Setting, SettingsGroup, Values

if TYPE_CHECKING:
    from gsedit.editing.result import EditResult
    from gsedit.paper.draw import EditPlan
    from gsedit.paper.request import Views
    from gsedit.paper.settings import EditSettings
    from gsedit.runs.events import Event
    from gsedit.words.instruction import Instruction as Words

LEFTOVERS = ("metrics.unfinished.jsonl", "command", OBJECTS)
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
    instruction: str
    folder: Path
    """Folder for the results."""
    own: EditOptions
    views: ViewOptions
    editor: EditorOptions
    values: Values
    common: Seeded
    masks: MaskOptions = NO_MASKS
    sized: bool = True
    """Whether the size of the views, where there is one, was asked for."""

    @property
    def drawn(self) -> bool:
        """Whether an option asks that a 2D editor draws all."""
        return not self.own.asks_routes or asks_editor(self.editor, self.values)

    def steps(self) -> tuple[Words, ...]:
        """Return the steps of the sentence. Raises UsageError for one that is refused."""
        return read_sentence(self.instruction, self.scene, drawn=self.drawn)

    def kept(self) -> dict[str, Any]:
        """Return the part of the request that a checkpoint keeps beside the library's."""
        return {"editor": replace(self.editor.settled(), yes=False), "features": self.own.features}


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
    request = scene, instruction, folder, own, views, editor, values, common
    result = run_edit(EditCommand(*request, masks=masks))
    if result is not None:
        print_edit(result, folder, as_json=common.json)


def all_settings() -> list[Setting]:
    """Return every setting of an edit and of its strategies."""
    return edit_settings(own_flags(edit))


def run_edit(asked: EditCommand) -> EditResult | None:
    """Edit as a sentence says, with progress on the terminal, and write the folder.

    Returns None on all ranks but the first, and where the edit is only explained.
    """
    from gsedit.editing.plan import is_exact

    steps, own, folder, kept = asked.steps(), asked.own, asked.folder, asked.kept()
    exact = all(map(is_exact, steps))
    if (own.explain and any(map(is_exact, steps))) or (exact and not is_first()):
        return print_routes(steps) if own.explain else None
    names, state = names_of(asked.scene, asked.masks, steps), None
    if not own.explain:
        check_apart(asked.scene, folder)
        state = load_resume_state(folder / NAME, kept, "edit", resume=own.resume, force=own.force)
        check_folder(folder, own.force or state is not None, leftovers=LEFTOVERS)
    asked.common.apply()
    if not exact:
        say_threads(state)
    settings, how = asked_of_editor(asked, exact=exact)
    gaussians = load_scene(asked.scene, drop_invalid=own.drop_invalid)
    say_kernel(settings.execution, RENDERS if exact else UPDATES)
    if not asked.drawn:
        print_message(f"understood as: {'; '.join(map(str, steps))}")
    views = views_of(asked.scene, gaussians, asked.views, settings.execution, drawn=not exact)

    from gsedit.editing.edit import edit_steps, plan_edit
    from gsedit.editing.folder import write_edit
    from gsedit.runs.events import events_of

    request = {"settings": settings, "names": names, **how, "generator": asked.common.generator()}
    if own.explain:
        plan = plan_edit(gaussians, asked.instruction, views, **request)
        return print_plan(plan, as_json=asked.common.json)
    items = edit_steps(gaussians, asked.instruction, views, **request, resume=state, ranks=ranks())
    if not is_first():
        return drain(items)
    source = {"scene": asked.scene.absolute(), "drop_invalid": own.drop_invalid}
    check = partial(check_folder, folder, own.force or state is not None, leftovers=LEFTOVERS)
    with (
        Checkpoints(folder / NAME, kept, source, check) as checkpoints,
        numbered(folder / OBJECTS, gaussians, views),
    ):
        earlier = [] if state is None else events_of(state)
        result = run_and_show(items, folder, checkpoints, earlier, as_json=asked.common.json)
        carry_beside(asked.scene, gaussians, result, folder)
        write_views(views, result, folder)
        write_edit(folder, result, request=request_of(asked, exact=exact), overwrite=True)
    print_message(f"{result.metrics.describe()}; {result.timings['total']:.1f} s")
    say_where(folder)
    return result


def asked_of_editor(asked: EditCommand, *, exact: bool) -> tuple[EditSettings, dict[str, Any]]:
    """Return the settings, and what the library is asked of a 2D editor.

    Raises UsageError for options that cannot be heeded, or a sentence that it cannot follow.
    """
    own, values = asked.own, asked.values
    settings, strategy = resolve(own.preset, values, own_flags(edit))
    if exact or not asked.drawn:
        return settings, {}
    from gsedit.paper import request as traits

    traits.check_strategy(strategy)
    if idle := idle_options(values, settings, own_flags(edit)):
        print_message(f"{', '.join(idle)}: no effect where colors are solved for (--loss mse)")
    check_condition(settings.condition, asked.views.data)
    followed = asked.instruction if traits.asks_editor(strategy) else None
    editor = asked.editor.make(asked.folder, followed, settings.sampler.precision)
    settings = at_size(settings, editor, asked.views.size if asked.sized else None)
    features = load_features(own.features)
    if own.preset == "paper" and own.features == "filters":
        print_message("a filter bank stands in for VGG's features, see --features")
    return settings, {"editor": editor, "strategy": strategy, "features": features}


def request_of(asked: EditCommand, *, exact: bool) -> dict[str, Any]:
    """Return what edit.json tells of the command."""
    from gsedit.editing.folder import history_of

    own, views = asked.own, asked.views
    editor = {"editor": AUTO} if exact else asked.kept()["editor"]
    return {
        "scene": asked.scene, "drop_invalid": own.drop_invalid, **asdict(views),
        "size": views.pixels, "editor": editor, "preset": own.preset, "features": own.features,
        "seed": asked.common.seed, "ranks": ranks().size, **history_of(asked.scene),
    }  # fmt: skip


def print_routes(steps: Sequence[Words]) -> None:
    """Print what is done on the Gaussians, where an edit is only explained."""
    print_message(f"{'; '.join(map(str, steps))}: done on the Gaussians, no view is edited")


def print_edit(result: EditResult, folder: Path, *, as_json: bool) -> None:
    """Print the place of the edited scene."""
    record = {
        "folder": folder,
        "scene": folder / "scene.ply",
        "ground_truth": result.metrics.psnr_to_ground_truth,
        "psnr_outside_region": result.metrics.psnr_outside_region,
    }
    print_result(record, str(folder / "scene.ply"), as_json=as_json)


def write_views(views: Views, result: EditResult, folder: Path) -> None:
    """Write the cameras that other commands read, and the views that gsedit metrics measures."""
    from gsedit.datasets.cameras_json import write_cameras
    from gsedit.datasets.dataset import Dataset
    from gsedit.datasets.view_list_files import by_edit, write_view_list
    from gsedit.datasets.viewpoints import viewpoints_of

    viewpoints = viewpoints_of(views) if isinstance(views, Dataset) else views
    write_cameras(viewpoints, folder / "cameras.json", overwrite=True)
    edited = by_edit(viewpoints, {view.name for view in result.originals})
    write_view_list(edited, folder / "views.json", overwrite=True)


def print_plan(plan: EditPlan, *, as_json: bool) -> None:
    """Print the work that an edit would skip, and what it would take."""
    print_result(plan._asdict(), plan.describe(), as_json=as_json)


def run_and_show(
    items: Iterable[Any],
    out: Path,
    checkpoints: Checkpoints,
    earlier: Iterable[Event],
    *,
    as_json: bool,
) -> EditResult:
    """Run an edit, show its events, and print what was found and measured.

    Until the folder `out` is written it holds the last checkpoint and the events so far, which
    begin with the `earlier` ones of a resumed edit.
    """
    from gsedit.measures.against import UNFINISHED
    from gsedit.pictures.figures import table
    from gsedit.runs.events import Checkpoint, Event, as_record
    from gsedit.runs.json_lines import Journal

    journal = Journal(out / UNFINISHED, as_record)
    for event in earlier:
        journal.write(event)
    with progress(as_json=as_json) as show:

        def write_and_show(event: Event) -> None:
            with suppress(OSError):  # a full disk; the result lists all events
                journal.write(event)
            show(event)

        result = result_of(items, {Event: write_and_show, Checkpoint: checkpoints.keep})
    if result.events:
        print_message(table(journal.records))
    say_found(result)
    return result
