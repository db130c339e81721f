"""`gsedit edit`: change a scene as a sentence says."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gsedit.errors import Said, UsageError

from ..core.checkpoints import NAME, Checkpoints, load_resume_state, say_threads
from ..core.command import Seeded, Settings, Values, argument, option, shows, with_values
from ..core.console import print_message, print_result
from ..core.kernel import RENDERS, UPDATES, say_kernel
from ..core.outputs import check_folder
from ..core.progress import progress, result_of, stage_table
from ..options.cameras import ViewOptions, resolve_cameras
from ..options.common import Reads, Resumes, Scene, load_features, load_scene
from ..options.editors import (
    AUTO,
    OBJECTS,
    EditorOptions,
    asks_editor,
    at_size,
    edit_settings,
    idle_settings,
    names_of,
    numbered,
    read_sentence,
    resolve,
    views_of,
)
from ..options.selection import AtOptions, MaskOptions

if TYPE_CHECKING:
    from gsedit.editing.measure import EditResult
    from gsedit.paper.settings import EditSettings
    from gsedit.run.events import Event
    from gsedit.views.viewpoints import Views
    from gsedit.words.instruction import Instruction as Words
    from rasterizer.scene import Gaussians

LEFTOVERS = ("metrics.unfinished.jsonl", "command", OBJECTS)
"""Files of an edit that ended before its first checkpoint: alone they need no protection."""
NO_MASKS = MaskOptions()

Instruction = Annotated[str, argument("INSTRUCTION", "What should change, as in 'make it snow'.")]


@dataclass(frozen=True)
class EditOptions(Reads, Resumes):
    """Options of `gsedit edit` alone."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """Folder for the results."""
    explain: bool = option(False)
    """Edit nothing: print the work that the edit would skip, why, the largest error that skipping
    can cause, and the time and memory that a large 2D model would take."""
    preview: bool = option(False)
    """Edit nothing: draw one view, before and after, into -o FILE.png (preview.png)."""
    accept_unread: bool = option(False)
    """Do what was read of the sentence, though the reading is not sure."""
    reader: str | None = option(None, "URL")
    """Let the language model of this server read the sentence (llama.cpp, ollama, ...)."""
    preset: str = option("default", "default|quick|paper")
    """Values of the options that are not given. quick: half of the evaluations of a 2D model.
    paper: Efficient-NeRF2NeRF as printed; gsedit list presets shows all that each sets."""
    features: str = option("filters", "filters|vgg")
    """Features of the Gram loss. filters: a filter bank. vgg: the VGG16 of stlpips_pytorch
    (gsedit[perceptual])."""


@dataclass(frozen=True)
class EditCommand:
    """Everything that `gsedit edit` was asked."""

    scene: Path
    instruction: str
    folder: Path
    """Folder for the results; the file of a preview."""
    own: EditOptions
    views: ViewOptions
    editor: EditorOptions
    values: Values
    common: Seeded
    masks: MaskOptions = NO_MASKS
    sized: bool = True
    """Whether the size of the views, where there is one, was asked for."""

    @property
    def asks(self) -> bool:
        """Whether an option is for what a 2D editor draws."""
        own, usual = self.own, EditOptions()
        asks = (own.preset, own.features) != (usual.preset, usual.features)
        return asks or asks_editor(self.editor, self.values)

    def steps(self) -> tuple[Words, ...]:
        """Return the steps of the sentence. Raises UsageError for one that is refused, and for
        options of a 2D editor where nothing is drawn."""
        from gsedit.editing.plan import is_exact

        drawn, unread = self.editor.draws_all, self.own.accept_unread
        steps = read_sentence(self.instruction, self.scene, drawn=drawn, accept_unread=unread)
        if self.asks and all(map(is_exact, steps)):
            what = f"{self.instruction.strip()!r} asks for nothing that is drawn"
            raise UsageError(Said(what, "undrawn"))
        return steps

    def kept(self) -> dict[str, Any]:
        """Return the part of the request that a checkpoint keeps beside the library's."""
        return {"editor": self.editor.settled(), "features": self.own.features}

    def load(self) -> Gaussians:
        """Load the scene, with a line for each note on its file."""
        return load_scene(self.scene, drop_invalid=self.own.drop_invalid)


@shows(
    "--output", "--data", "--region", "--at", "--editor", "--preview", "--size", "--explain",
    "--resume", "--force", "--seed",
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
    values: Annotated[Values, Settings(edit_settings)],
    common: Seeded,
) -> None:
    """Edit a scene from a sentence.

    gsedit edit scene.ply "turn it into a bronze statue" --data posed/ -o out

    The folder gets the edited scene.ply, before_after.png, edit.json (settings, quality, timings)
    and the files that --resume, gsedit metrics and further edits read. SCENE may be such a folder.

    Without --data, the views are renders from the cameras.json beside the scene, or from
    viewpoints that gsedit finds. gsedit list settings edit explains every setting.
    """
    values = pointing.in_place_of_region(values)
    out = preview_file(own) if own.preview else own.out
    check_request(instruction, views, own, out)
    if own.reader:
        from gsedit.words.model import changes_by_model

        instruction = changes_by_model(instruction, own.reader)
    request = scene, instruction, out or Path(), own, views, editor, values, common
    asked = EditCommand(*request, masks=masks)
    if own.preview:
        return run_preview(asked)
    if (result := run_edit(asked)) is not None:
        record = {
            "folder": out,
            "scene": asked.folder / "scene.ply",
            "ground_truth": result.metrics.psnr_to_ground_truth,
            "psnr_outside_region": result.metrics.psnr_outside_region,
        }
        print_result(record, str(record["scene"]))


def preview_file(own: EditOptions) -> Path:
    """Return the file of a preview. Raises UsageError for what is no PNG."""
    if own.explain or own.resume:
        raise UsageError("--preview writes one picture: leave out --explain and --resume")
    path = own.out or Path("preview.png")
    if path.suffix.lower() != ".png":
        raise UsageError(f"-o {path}: a preview is one picture, name it as in -o {path}.png")
    return path


def check_request(instruction: str, views: ViewOptions, own: EditOptions, out: Path | None) -> None:
    """Raise UsageError for an empty sentence or no output, before any file is read."""
    if not instruction.strip():
        raise UsageError("the instruction is empty: say what should change, as in 'make it snow'")
    views.check()
    if out is None and not own.explain:
        raise UsageError("-o is missing: name a folder for the results, or add --explain")


def run_preview(asked: EditCommand) -> None:
    """Write one view before and after, as a picture: nothing else is written."""
    from gsedit.editing.plan import is_exact
    from gsedit.editing.preview import drawn_region, preview_edited, preview_exact
    from gsedit.formats.pictures import save_picture
    from gsedit.paper.settings import EditSettings
    from gsedit.run.atomic import check_writable
    from gsedit.select.finder import Finder
    from gsedit.views.viewpoints import same_size

    check_writable(asked.folder, overwrite=asked.own.force)
    path, steps = asked.folder, asked.steps()
    first, exact = steps[0], is_exact(steps[0])
    names = names_of(asked.scene, asked.masks, steps[:1])
    own = {at: value for at, value in asked.values.items() if at[0] != "strategy"}
    settings = with_values(EditSettings(), own)
    made = partial(asked.editor.make, path.parent, first, settings.sampler.precision)
    followed, gaussians = None if exact else made(), asked.load()
    say_kernel(settings.execution)
    found = resolve_cameras(asked.scene, gaussians, asked.views)
    viewpoints = same_size(found.viewpoints, asked.views.pixels)
    if len(steps) > 1:
        print_message(f"the first of {len(steps)} steps: {first.text}")
    if not asked.editor.draws_all:
        print_message(f"understood as: {first}")
    if followed is None:
        with numbered(path.with_name(OBJECTS), gaussians, viewpoints):
            shown = preview_exact(gaussians, first, viewpoints, settings.region, names)
        for note in shown.notes:
            print_message(note)
    else:
        settings, region = at_size(settings, followed, asked.views.size), None
        if not asked.editor.draws_all:
            finder = Finder(gaussians, viewpoints, settings.region, names)
            region = drawn_region(finder, first, followed)
        shown = preview_edited(
            gaussians, first, viewpoints[0].camera, followed, asked.common.seed,
            settings.sampler, settings.edit_size, region,
        )  # fmt: skip
    save_picture(shown.picture(), path, overwrite=asked.own.force)
    print_result({"picture": path}, str(path))


def run_edit(asked: EditCommand) -> EditResult | None:
    """Edit as a sentence says, with progress on the terminal, and write the folder.

    Returns None where the edit is only explained.
    """
    from gsedit.editing.plan import is_exact

    steps, own, folder, kept = asked.steps(), asked.own, asked.folder, asked.kept()
    exact = all(map(is_exact, steps))
    if own.explain and any(map(is_exact, steps)):
        read = "; ".join(map(str, steps))
        return print_message(f"{read}: done on the Gaussians, no view is edited")
    names, state = names_of(asked.scene, asked.masks, steps), None
    if not own.explain:
        check_apart(asked.scene, folder)
        state = load_resume_state(folder / NAME, kept, "edit", resume=own.resume, force=own.force)
        check_folder(folder, own.force or state is not None, leftovers=LEFTOVERS)
    if not exact:
        say_threads(state)
    settings, how = asked_of_editor(asked, next((e for e in steps if not is_exact(e)), None))
    gaussians = asked.load()
    say_kernel(settings.execution, RENDERS if exact else UPDATES)
    if not asked.editor.draws_all:
        print_message(f"understood as: {'; '.join(map(str, steps))}")
    views = views_of(asked.scene, gaussians, asked.views, drawn=not exact)

    from gsedit.editing.edit import edit_steps, plan_edit
    from gsedit.editing.folder import write_edit
    from gsedit.run.events import events_of

    request = {"settings": settings, "names": names, "steps": steps, **how}
    request["generator"] = asked.common.generator()
    if own.explain:
        plan = plan_edit(gaussians, asked.instruction, views, **request)
        return print_result(plan._asdict(), plan.describe())
    items = edit_steps(gaussians, asked.instruction, views, **request, resume=state)
    source = {"scene": asked.scene.absolute(), "drop_invalid": own.drop_invalid}
    check = partial(check_folder, folder, own.force or state is not None, leftovers=LEFTOVERS)
    with (
        Checkpoints(folder / NAME, kept, source, check) as checkpoints,
        numbered(folder / OBJECTS, gaussians, views),
    ):
        earlier = [] if state is None else events_of(state)
        result = run_and_show(items, folder, checkpoints, earlier)
        carry_beside(asked.scene, gaussians, result, folder)
        write_views(views, result, folder)
        write_edit(folder, result, request=request_of(asked, exact=exact), overwrite=True)
    print_message(
        f"{result.metrics.describe()}; {result.timings['total']:.1f} s\n"
        f"results are in {folder}; look at {folder / 'before_after.png'}, then: "
        f"gsedit view {folder / 'scene.ply'}"
    )
    return result


def check_apart(scene: Path, out: Path) -> None:
    """Raise UsageError where the results would replace the scene that is edited."""
    if os.path.realpath(scene) == os.path.realpath(out / "scene.ply"):
        raise UsageError(f"-o {out} is the folder of the scene that is edited: name another folder")


def asked_of_editor(asked: EditCommand, drawn: Words | None) -> tuple[EditSettings, dict[str, Any]]:
    """Return the settings, and what the library is asked of a 2D editor; `drawn` is its first step.

    Raises UsageError for options that cannot be heeded, or a sentence that it cannot follow.
    """
    own, values = asked.own, asked.values
    settings, strategy = resolve(own.preset, values)
    if drawn is None or not asked.asks:
        return settings, {}
    if idle := idle_settings(values, settings):
        print_message(f"{', '.join(idle)}: no effect where colors are solved for (--loss mse)")
    if settings.condition == "photo" and asked.views.data is None:
        raise UsageError("--condition photo shows the editor the photos: name them with --data")
    editor = asked.editor.make(asked.folder, drawn, settings.sampler.precision)
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
        "seed": asked.common.seed, **history_of(asked.scene),
    }  # fmt: skip


def carry_beside(path: Path, scene: Gaussians, result: EditResult, folder: Path) -> None:
    """Write what lies beside the scene that was edited for the one in the folder: its saved
    selections, and the file that names its frame, which is the same."""
    from gsedit.select.saved import carry_named
    from gsedit.views import export_frame as frames

    before, after = (each.means.detach().numpy() for each in (scene, result.scene))
    origin = None if result.origin is None else result.origin.numpy()
    carry_named(path, before, folder / "scene.ply", after, origin)
    file = frames.dataparser_file(path)
    if file is not None:
        frames.write_dataparser(frames.read_dataparser(file), folder / frames.NAME, overwrite=True)
    else:
        (folder / frames.NAME).unlink(missing_ok=True)  # an earlier run's


def write_views(views: Views, result: EditResult, folder: Path) -> None:
    """Write the cameras that other commands read, and the views that gsedit metrics measures."""
    from gsedit.views.cameras_json import write_cameras
    from gsedit.views.view_list_files import by_edit, write_view_list
    from gsedit.views.viewpoints import viewpoints_of

    viewpoints = viewpoints_of(views)
    write_cameras(viewpoints, folder / "cameras.json", overwrite=True)
    measured = result.views or by_edit(viewpoints, ())
    write_view_list(measured, folder / "views.json", overwrite=True)


def run_and_show(
    items: Iterable[Any], out: Path, checkpoints: Checkpoints, earlier: Iterable[Event]
) -> EditResult:
    """Run an edit, show its events, and print what was found and measured.

    Until the folder `out` is written it holds the last checkpoint and the events so far, which
    begin with the `earlier` ones of a resumed edit.
    """
    from gsedit.measures.against import UNFINISHED
    from gsedit.run.events import Checkpoint, Event, as_record
    from gsedit.run.json_lines import Journal

    journal = Journal(out / UNFINISHED, as_record)
    for event in earlier:
        journal.write(event)
    with progress() as show:

        def write_and_show(event: Event) -> None:
            with suppress(OSError):  # a full disk; the result lists all events
                journal.write(event)
            show(event)

        result = result_of(items, {Event: write_and_show, Checkpoint: checkpoints.keep})
    if result.events:
        print_message(stage_table(journal.records))
    if result.understood is not None and not result.region.is_all:  # a drawing told its region
        print_message(f"region: {result.region.note}")
    for note in result.notes:
        print_message(note)
    return result
