"""One view before and after an edit, as a picture: nothing else is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.console import print_message, print_result
from ..core.kernel import say_kernel
from .cameras import ViewOptions, resolve_cameras
from .editing import EditorOptions, at_size
from .masks import MaskOptions
from .routes import OBJECTS, asks_editor, names_of, numbered, read_sentence
from .settings import Values, with_values

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
    from gsedit.cameras.around import FOUND_VIEWS
    from gsedit.datasets.viewpoints import same_size
    from gsedit.editing.plan import is_exact
    from gsedit.editing.preview import preview_edited, preview_exact
    from gsedit.formats.pictures import save_picture
    from gsedit.paper.settings import EditSettings
    from gsedit.storage.atomic import check_writable

    check_writable(path, overwrite=force)
    steps = read_sentence(instruction, scene, drawn=asks_editor(editor, values))
    first, exact = steps[0], is_exact(steps[0])
    names = names_of(scene, masks, steps[:1])
    own = {at: value for at, value in values.items() if at[0] != "strategy"}
    settings = with_values(EditSettings(), own)
    followed = None if exact else editor.make(path.parent, first.text, settings.sampler.precision)
    gaussians = load()
    say_kernel(settings.execution)
    resolved = resolve_cameras(scene, gaussians, views, FOUND_VIEWS, settings.execution)
    viewpoints = same_size(resolved.viewpoints, views.pixels)
    if len(steps) > 1:
        print_message(f"the first of {len(steps)} steps: {first.text}")
    if followed is None:
        print_message(f"understood as: {first}")
        with numbered(path.with_name(OBJECTS), gaussians, viewpoints):
            found = preview_exact(gaussians, first, viewpoints, settings, names)
        for note in found.notes:
            print_message(note)
    else:
        settings = at_size(settings, followed, views.size)
        found = preview_edited(
            gaussians, first.text, viewpoints[0].camera, followed, (seed,), settings.sampler,
            settings.execution, settings.edit_size,
        )  # fmt: skip
    save_picture(found.picture(), path, overwrite=force)
    print_result({"picture": path}, str(path), as_json=as_json)
