"""One view before and after an edit, as a picture: nothing else is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.console import print_result
from .cameras import ViewOptions
from .editing import EditorOptions
from .routes import exact_instruction, prepare
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
    seeds: range,
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Write the picture. Raises UsageError for a sentence that is refused, as the edit does."""
    from gsedit.editing.preview import preview_edited, preview_routed
    from gsedit.formats.pictures import save_picture
    from gsedit.storage.atomic import check_writable

    check_writable(path, overwrite=force)
    read = exact_instruction(instruction, editor, values)
    if read is not None and len(seeds) > 1:
        raise UsageError(f"{read} has one result, whatever the seed: leave out --seeds")
    followed = None if read is not None else editor.make(path.parent, instruction)
    ready = prepare(scene, load, views, values)
    if read is not None:
        asked = ready.asked(read)
        found = preview_routed(
            ready.scene, asked, ready.viewpoints, ready.region, ready.execution
        )  # fmt: skip
    else:
        assert followed is not None
        camera = ready.viewpoints[0].camera
        found = preview_edited(ready.scene, instruction, camera, followed, seeds, ready.execution)
    save_picture(found.picture(), path, overwrite=force)
    print_result({"picture": path}, str(path), as_json=as_json)
