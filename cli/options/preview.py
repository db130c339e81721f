"""One view before and after an edit, as a picture: nothing else is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.console import print_message, print_result
from .cameras import ViewOptions
from .editing import EditorOptions, at_size
from .masks import MaskOptions
from .routes import OBJECTS, names_of, numbered, prepare, read_sentence
from .settings import Values

if TYPE_CHECKING:
    from rasterizer.scene import Gaussians


def preview_file(out: Path | None) -> Path:
    """Return the file of a preview. Raises UsageError for what is no PNG."""
    path = out or Path("preview.png")
    if path.suffix.lower() != ".png":
        raise UsageError(f"-o {path}: a preview is one picture, name it as in -o {path}.png")
    return path


def run_preview(
    scene: Path,
    load: Callable[[], Gaussians],
    instruction: str,
    path: Path,
    views: ViewOptions,
    editor: EditorOptions,
    values: Values,
    seed: int,
    *,
    masks: MaskOptions,
    force: bool,
    as_json: bool,
) -> None:
    """Write the picture. Raises UsageError for a sentence that is refused, as the edit does."""
    from gsedit.editing.preview import preview_edited, preview_routed
    from gsedit.editing.routes.apply import is_exact
    from gsedit.formats.pictures import save_picture
    from gsedit.storage.atomic import check_writable

    check_writable(path, overwrite=force)
    steps = read_sentence(instruction, editor, values, scene)
    read = None if steps is None else steps[0]
    direct = read is not None and is_exact(read)
    words = instruction if read is None else read.text
    precision = values.get(("sampler", "precision"), "auto")
    followed = None if direct else editor.make(path.parent, words, precision)
    ready = prepare(scene, load, views, values)
    if steps is not None and len(steps) > 1:
        print_message(f"the first of {len(steps)} edits: {words}")
    given, viewpoints, settings = ready.scene, ready.viewpoints, ready.settings
    if followed is not None:
        masks.check_unused()
    if followed is None:
        assert read is not None
        print_message(f"understood as: {read}")
        names = names_of(scene, masks, read)
        with numbered(path.with_name(OBJECTS), ready):
            found = preview_routed(given, read, viewpoints, settings, names)
        for note in found.notes:
            print_message(note)
    else:
        settings = at_size(settings, followed, views.size)
        found = preview_edited(
            given, words, viewpoints[0].camera, followed, (seed,), settings.sampler,
            settings.execution, settings.edit_size,
        )  # fmt: skip
    save_picture(found.picture(), path, overwrite=force)
    print_result({"picture": path}, str(path), as_json=as_json)
