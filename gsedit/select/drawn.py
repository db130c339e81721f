"""Masks that a person drew on one photo or a few, as values of Gaussians."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import View
from gsedit.datasets.image_ops import downscale
from gsedit.datasets.undistort import Lens, undistort, undistortion
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.errors import InputError
from gsedit.formats.pictures import open_picture
from gsedit.storage.inputs import existing_file


def read_masks(path: Path, views: Sequence[View | Viewpoint]) -> dict[int, Float[Tensor, "h w"]]:
    """The masks in a PNG, or in all PNGs of a folder, by the index of the view that they belong to.

    A mask has the name of its view's picture: `frame_00001.png` belongs to the view
    `images/frame_00001.jpg`, and is drawn on the photo, whose lens distortion is undone; so does
    `000_frame_00001.png`, as `gsedit render` names the view, where there is none. White is inside,
    black and transparent outside. It may have another size than the view, and is averaged over the
    view's pixels. Raises InputError where no file is there, a name belongs to no
    view or to several, or a mask has another shape than its view.
    """
    files = sorted(path.glob("*.png")) if path.is_dir() else [existing_file(path)]
    if not files:
        raise InputError(f"{path} has no .png file: put masks there, named after their views")
    names: dict[str, list[int]] = {}
    for index, view in enumerate(views):
        names.setdefault(Path(view.name).stem, []).append(index)
    masks: dict[int, Tensor] = {}
    for file in files:
        index = _view_of(file, names)
        camera, lens = views[index].camera, views[index].lens
        is_photo = file.stem == Path(views[index].name).stem
        masks[index] = read_mask(file, camera.width, camera.height, lens if is_photo else None)
    return masks


def read_mask(
    file: Path, width: int, height: int, lens: Lens | None = None
) -> Float[Tensor, "{height} {width}"]:
    """The mask in a picture, averaged over the pixels of a view: white is 1, black and transparent
    0. The distortion of a lens is undone. Raises InputError for a file that is no picture, or of
    another shape than the view."""
    return _fitted(_read(file), width, height, lens, file)


def _view_of(file: Path, names: Mapping[str, Sequence[int]]) -> int:
    found = names.get(file.stem) or names.get(re.sub(r"^\d+_", "", file.stem), ())
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{file}: {len(found)} views are named {file.stem}: rename the photos")
    listed = ", ".join(list(names)[:4])
    raise InputError(
        f"{file} belongs to no view: name it after a view's picture ({listed}, ...) with .png"
    )


def _read(file: Path) -> Float[Tensor, "h w"]:
    """Brightness times opacity, in [0, 1]."""
    with open_picture(file) as picture:
        levels = np.array(picture.convert("LA"))
    brightness, opacity = torch.from_numpy(levels).float().div(255).unbind(-1)
    return brightness * opacity


def _fitted(
    mask: Float[Tensor, "h w"], width: int, height: int, lens: Lens | None, file: Path
) -> Float[Tensor, "{height} {width}"]:
    rows, columns = mask.shape
    if abs(columns / rows - width / height) > 0.02 * width / height:
        raise InputError(
            f"{file} is {columns}x{rows} and its view {width}x{height}: draw it on the same picture"
        )
    if lens is not None:
        mask = undistort(mask[..., None], undistortion(lens.scaled(columns, rows)))[..., 0]
    return downscale(mask[..., None], width, height)[..., 0].clamp(0, 1)
