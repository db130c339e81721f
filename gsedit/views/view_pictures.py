"""Pictures of views in a folder, each under the name of its view: images/a.jpg as images/a.png."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.formats.pictures import as_picture, read_picture, save_picture
from gsedit.run.inputs import file_inside, picture_names
from gsedit.views.dataset import View
from gsedit.views.image_ops import downscale
from gsedit.views.viewpoints import Viewpoint

SUFFIXES = (".png", ".jpg", ".jpeg")


class NoPicturesError(InputError):
    """No picture of a folder belongs to a view."""


def write_view_pictures(
    folder: Path, views: Sequence[View], *, overwrite: bool = False
) -> list[str]:
    """Write PNGs of 8 bits a channel; their names in the folder. Raises InputError for a view whose
    name leaves the folder, UsageError as `atomic_path` does."""
    names = picture_names([view.name for view in views])
    for name, view in zip(names, views):
        file = file_inside(folder, name, str(folder))  # not through a link either
        save_picture(as_picture(view.image), file, overwrite=overwrite)
    return names


def read_view_pictures(
    folder: Path, viewpoints: Sequence[Viewpoint]
) -> dict[int, Float[Tensor, "h w 3"]]:
    """The pictures of a folder in [0, 1], by the index of their view, at the size of its camera.

    The file images/a.png belongs to the view images/a.jpg; where the folders differ, the name of
    the file alone decides, and `000_a.png` is a too, as `gsedit render` names it. Views without a
    picture, and pictures of other views, are left out. Raises InputError where no file belongs to a
    view, one belongs to several, two belong to one, or a picture is smaller than its view or of
    another shape.
    """
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES)
    if not files:
        raise InputError(f"{folder} has no pictures: put them there, named after their views")
    found: dict[int, Path] = {}
    written = picture_names([viewpoint.name for viewpoint in viewpoints])
    for file in files:
        index = view_of(file.relative_to(folder), [v.name for v in viewpoints], written)
        if index is None:
            continue
        if index in found:
            raise InputError(f"{found[index]} and {file} are pictures of one view: remove one")
        found[index] = file
    if not found:
        listed = ", ".join(str(Path(v.name).with_suffix(".png")) for v in viewpoints[:2])
        raise NoPicturesError(
            f"{folder}: no picture belongs to a view: name them after the views ({listed}, ...)"
        )
    return {index: _fitted(found[index], viewpoints[index]) for index in sorted(found)}


def view_of(file: Path, views: Sequence[str], written: Sequence[str] = ()) -> int | None:
    """The index of the view that a file (relative to its folder) belongs to; None where it belongs
    to none. `written`: the names that `write_view_pictures` gives the views. Raises InputError
    where it belongs to several."""
    path = file.with_suffix("")
    names = [Path(view).with_suffix("") for view in views]
    stem = re.sub(r"^\d+_", "", path.name)
    matches = (
        [i for i, name in enumerate(written) if name == file.as_posix()],
        [i for i, name in enumerate(names) if name == path],
        [i for i, name in enumerate(names) if name.name == path.name],
        [i for i, name in enumerate(names) if name.name == stem],
    )
    found = next((each for each in matches if each), [])
    if len(found) > 1:
        raise InputError(f"{file}: {len(found)} views are named {path.name}: keep their folders")
    return found[0] if found else None


def _fitted(file: Path, viewpoint: Viewpoint) -> Float[Tensor, "h w 3"]:
    """Averaged over the pixels of the view."""
    picture, camera = read_picture(file), viewpoint.camera
    rows, columns, _ = picture.shape
    shape = camera.width / camera.height
    if abs(columns / rows - shape) > 0.02 * shape:
        raise InputError(
            f"{file} is {columns}x{rows} and its view {camera.width}x{camera.height}: their "
            "proportions differ; give pictures of these views"
        )
    if columns < camera.width or rows < camera.height:
        raise InputError(
            f"{file} is {columns}x{rows}, smaller than its view, {camera.width}x{camera.height}: "
            f"measure at --size {max(columns, rows)}"
        )
    return downscale(picture, camera.width, camera.height).clamp(0, 1)
