"""What `gsedit edit` is asked: its sentence, names and views; and what it writes beside a scene."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.console import print_message
from .cameras import ViewOptions, framed_alike, resolve_cameras
from .editing import EditorOptions
from .masks import MaskOptions
from .settings import Values

if TYPE_CHECKING:
    from gsedit.editing.result import EditResult
    from gsedit.paper.request import Views
    from gsedit.select.finder import Names
    from gsedit.words.instruction import Instruction
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians


NO_MASKS = MaskOptions()
OBJECTS = "objects.png"
"""Picture of the numbers of objects, where a sentence may mean several."""


def asks_editor(editor: EditorOptions, values: Values) -> bool:
    """Whether an option asks that a 2D editor draws all of a sentence."""
    from gsedit.editing.plan import HEEDED

    return editor != EditorOptions() or any(path[0] not in HEEDED for path in values)


def read_sentence(
    text: str, scene: Path | None = None, *, drawn: bool = False
) -> tuple[Instruction, ...]:
    """Return the steps of a sentence, in order; where all is `drawn`, one with the sentence as is.

    Names of the selections that are saved beside the scene are what they were saved for.
    Raises UsageError for a sentence that is refused, InputError for a file to put in that is none.
    """
    from gsedit.editing.plan import read_steps
    from gsedit.formats.registry import open_scene
    from gsedit.select.saved import saved_files

    steps = read_steps(text, () if scene is None else tuple(saved_files(scene)), drawn=drawn)
    for change in (each for step in steps for each in step.changes):
        if change.name == "insert":
            open_scene(change.phrase)  # before the long work
    return steps


def names_of(scene: Path, masks: MaskOptions, steps: Sequence[Instruction]) -> Names:
    """Return what the phrases of a sentence may name: saved selections, and what masks find.

    Raises UsageError for masks that cannot look for a phrase, or that have none to look for.
    """
    from gsedit.editing.plan import is_exact
    from gsedit.select.finder import Names
    from gsedit.select.saved import saved_files
    from gsedit.words.phrases import IT

    if not any(map(is_exact, steps)):
        masks.check_unused()
    phrases = [each.phrase for step in steps for each in step.changes]
    told = next((phrase for phrase in phrases if phrase not in ("", IT)), None)
    if masks.masks is not None and told is None:
        raise UsageError('--masks finds what a sentence names, as in "remove the chair": say that')
    return Names(saved_files(scene), masks.make(told))


def views_of(
    path: Path, scene: Gaussians, options: ViewOptions, execution: Execution, *, drawn: bool
) -> Views:
    """Return the views of an edit: photos of --data that a 2D editor may be shown, or cameras.

    Of many recorded cameras a 2D editor is shown views from some.
    """
    from gsedit.cameras.around import FOUND_VIEWS
    from gsedit.datasets.viewpoints import same_size, that_see, thinned

    resolved = resolve_cameras(path, scene, options, FOUND_VIEWS, execution)
    if drawn and resolved.photos is not None:
        return framed_alike(resolved.photos)
    viewpoints = same_size(resolved.viewpoints, options.pixels)
    if not drawn or resolved.found:
        return viewpoints
    some = thinned(viewpoints)
    seeing = that_see(some, scene, execution)
    if len(seeing) < len(some):
        print_message(f"{len(some) - len(seeing)} cameras see nothing: they are skipped")
    return seeing


@contextmanager
def numbered(file: Path, scene: Gaussians, views: Views) -> Iterator[None]:
    """Draw the numbers of a scene's objects into a file where a sentence may mean several."""
    from gsedit.datasets.dataset import Dataset
    from gsedit.datasets.viewpoints import viewpoints_of
    from gsedit.editing.rivals import SeveralObjects
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.segment_sheet import segment_sheet
    from gsedit.select.phrase import names

    try:
        yield
    except SeveralObjects as error:
        viewpoints = viewpoints_of(views) if isinstance(views, Dataset) else views
        sheet = segment_sheet(scene, error.segments, names(error.segments), viewpoints)
        file.parent.mkdir(parents=True, exist_ok=True)
        save_picture(sheet, file, overwrite=True)
        raise UsageError(f"{error}; their numbers are drawn in {file}") from None


def check_request(instruction: str, views: ViewOptions, out: Path | None, explain: bool) -> Path:
    """Return the folder for the results. Raises UsageError before any file is read."""
    if not instruction.strip():
        raise UsageError("the instruction is empty: say what should change, as in 'make it snow'")
    views.check()
    if explain:
        return out or Path()
    if out is None:
        raise UsageError("-o is missing: name a folder for the results, or add --explain")
    return out


def check_apart(scene: Path, out: Path) -> None:
    """Raise UsageError where the results would replace the scene that is edited."""
    if os.path.realpath(scene) == os.path.realpath(out / "scene.ply"):
        raise UsageError(f"-o {out} is the folder of the scene that is edited: name another folder")


def check_condition(condition: str, data: Path | None) -> None:
    """Raise UsageError where the editor needs photos and there are none."""
    if condition == "photo" and data is None:
        raise UsageError("--condition photo shows the editor the photos: name them with --data")


def say_found(result: EditResult) -> None:
    """Print the region of an edit on the Gaussians, and its notes; a drawing told its region."""
    is_told = result.region.is_all or result.understood is None
    found = () if is_told else (f"region: {result.region.note}",)
    for note in (*found, *result.notes):
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
