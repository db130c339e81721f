"""Edits by exact routes: when a sentence takes them, and the folder that they write."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

from ..core.checkpoints import NAME
from ..core.console import print_message
from ..core.kernel import say_kernel
from ..core.ranks import is_first
from .cameras import ViewOptions, resolve_cameras
from .editing import AUTO, EditorOptions
from .masks import MaskOptions
from .settings import Values, with_values

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.editing.session.result import EditResult
    from gsedit.editing.session.settings import EditSettings
    from gsedit.select.finder import Names
    from gsedit.words.instruction import Instruction
    from rasterizer.scene import Gaussians


NO_MASKS = MaskOptions()
OBJECTS = "objects.png"
"""Picture of the numbers of objects, where a sentence may mean several."""


def read_sentence(
    text: str, editor: EditorOptions, values: Values, scene: Path | None = None
) -> tuple[Instruction, ...] | None:
    """Return the edits that a sentence takes, in order; None where an option asks for an editor.

    Names of the selections that are saved beside the scene are what they were saved for.
    Raises UsageError for a sentence that is refused, InputError for a file to put in that is none.
    """
    from gsedit.editing.routes.plan import HEEDED, steps_of

    if editor != EditorOptions() or any(path[0] not in HEEDED for path in values):
        return None
    from gsedit.formats.registry import open_scene
    from gsedit.select.saved import saved_files
    from gsedit.words.called import read_called

    instruction = read_called(text, () if scene is None else tuple(saved_files(scene)))
    for change in instruction.changes:
        if change.name == "insert":
            open_scene(change.phrase)  # before the long work
    return steps_of(instruction)


def names_of(scene: Path, masks: MaskOptions, instruction: Instruction) -> Names:
    """Return what the phrases of a sentence may name: saved selections, and what masks find.

    Raises UsageError for masks that cannot look for a phrase, or that have none to look for.
    """
    from gsedit.select.finder import Names
    from gsedit.select.saved import saved_files
    from gsedit.words.phrases import IT

    phrases = [each.phrase for each in instruction.changes]
    told = next((phrase for phrase in phrases if phrase not in ("", IT)), None)
    if masks.masks is not None and told is None:
        raise UsageError('--masks finds what a sentence names, as in "remove the chair": say that')
    return Names(saved_files(scene), masks.make(told))


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scene that is read, and the views in which routes look at it."""

    scene: Gaussians
    viewpoints: tuple[Viewpoint, ...]
    settings: EditSettings


def prepare(
    scene: Path, load: Callable[[], Gaussians], views: ViewOptions, values: Values
) -> Prepared:
    """Read the scene, and find its views."""
    from gsedit.cameras.around import FOUND_VIEWS
    from gsedit.datasets.viewpoints import same_size
    from gsedit.editing.session.settings import EditSettings

    own = {path: value for path, value in values.items() if path[0] != "strategy"}
    settings = with_values(EditSettings(), own)
    gaussians = load()
    say_kernel(settings.execution)
    resolved = resolve_cameras(scene, gaussians, views, FOUND_VIEWS, settings.execution)
    return Prepared(gaussians, same_size(resolved.viewpoints, views.pixels), settings)


@contextmanager
def numbered(file: Path, ready: Prepared) -> Iterator[None]:
    """Draw the numbers of a scene's objects into a file where a sentence may mean several."""
    from gsedit.editing.routes.rivals import SeveralObjects
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.segment_sheet import segment_sheet
    from gsedit.select.looks import names

    try:
        yield
    except SeveralObjects as error:
        told = names(error.segments)
        sheet = segment_sheet(ready.scene, error.segments, told, ready.viewpoints)
        file.parent.mkdir(parents=True, exist_ok=True)
        save_picture(sheet, file, overwrite=True)
        raise UsageError(f"{error}; their numbers are drawn in {file}") from None


def run_routes(
    scene: Path,
    load: Callable[[], Gaussians],
    instruction: Instruction,
    folder: Path,
    views: ViewOptions,
    values: Values,
    more: Mapping[str, Any],
    masks: MaskOptions = NO_MASKS,
) -> EditResult | None:
    """Edit a scene by exact routes and write the folder; None on all ranks but the first.

    `more` is added to the request in edit.json. Raises UsageError as `apply_change`, `names_of`.
    """
    if not is_first():
        return None
    from gsedit.datasets.cameras_json import write_cameras
    from gsedit.datasets.view_list_files import by_edit, write_view_list
    from gsedit.editing.routes.result import assumed, routed_result
    from gsedit.editing.session.folder import history_of, write_edit
    from gsedit.runs.stopwatch import Stopwatch
    from gsedit.storage.atomic import locked

    watch, names = Stopwatch(), names_of(scene, masks, instruction)
    with locked(folder / NAME):
        with watch.stage("read"):
            gaussians = load()  # bad input is told in one line: nothing is printed before
            print_message(f"understood as: {instruction}; done on the Gaussians, no view is edited")
            ready = prepare(scene, lambda: gaussians, views, values)
            for note in (told := assumed(instruction, ready.settings, names)):
                print_message(note)
        viewpoints = ready.viewpoints
        asked = ready.scene, instruction, viewpoints, ready.settings, watch, names
        with numbered(folder / OBJECTS, ready):
            result = routed_result(*asked)
        say_found(result, len(told))
        request = {"scene": scene, **asdict(views), "editor": {"editor": AUTO}}
        write_cameras(viewpoints, folder / "cameras.json", overwrite=True)
        write_view_list(by_edit(viewpoints, ()), folder / "views.json", overwrite=True)
        carry_beside(scene, ready.scene, result, folder)
        write_edit(folder, result, request={**request, **history_of(scene), **more}, overwrite=True)
    print_message(f"{result.metrics.describe()}; {result.timings['total']:.1f} s")
    say_where(folder)
    return result


def own_region(values: Values, first: Path, scene: Path) -> Values:
    """Return the settings of a step of an edit with its own flags of a saved selection.

    `first` is the scene before all steps, that the region of the settings was saved for.
    """
    from gsedit.select.saved import folder_of

    region = Path(str(values.get(("region",), "")))
    own = folder_of(scene) / region.name
    is_saved = region.parent == folder_of(first) and own.is_file()
    return {**values, ("region",): str(own)} if is_saved else values


def say_found(result: EditResult, told: int) -> None:
    """Print the region of an edit and its notes but for the first ones, which were told."""
    found = () if result.region.is_all else (f"region: {result.region.note}",)
    for note in (*found, *result.notes[told:]):
        print_message(note)


def say_where(folder: Path) -> None:
    """Print the folder of an edit, and how to look at what is in it."""
    print_message(
        f"results are in {folder}; look at {folder / 'before_after.png'}, then: "
        f"gsedit view {folder / 'scene.ply'}"
    )


def carry_beside(path: Path, scene: Gaussians, result: EditResult, folder: Path) -> None:
    """Write what lies beside the scene that was edited for the one in the folder: its saved
    selections, and the file that names its frame, which is the same."""
    from gsedit.datasets import export_frame as frames
    from gsedit.select.saved import carry_named

    before, after = (each.means.detach().numpy() for each in (scene, result.scene))
    origin = None if result.origin is None else result.origin.numpy()
    carry_named(path, before, folder / "scene.ply", after, origin)
    file = frames.dataparser_file(path)
    if file is not None:
        frames.write_dataparser(frames.read_dataparser(file), folder / frames.NAME, overwrite=True)
    else:
        (folder / frames.NAME).unlink(missing_ok=True)  # an earlier run's
