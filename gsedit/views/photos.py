"""Posed photos, not read yet, and sparse points: the records that every dataset format fills."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.formats.limits import check_points
from gsedit.formats.pictures import picture_size
from gsedit.formats.ply.records import element_blocks, read_ply_header
from gsedit.run.inputs import file_inside
from gsedit.views.undistort import Lens

SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")
REDUCED = (8, 4, 2)
"""images_8, images_4, images_2 beside images: the photos made so many times smaller, as INRIA's
trainer, mip-NeRF 360's captures and nerfstudio have them."""


@dataclass(frozen=True, eq=False)
class PosedPhoto:
    """A photo's file with its pose and its lens."""

    name: str
    """Its file, relative to the folder of photos."""
    path: Path
    world_to_camera: Float[Tensor, "4 4"]
    """Camera pose in OpenCV axes, float64."""
    lens: Lens
    """As it was calibrated: the photo may have another number of pixels."""
    mask: Path | None = None
    """A picture that is black where the photo is not to be used."""


class SparsePoints(NamedTuple):
    """World positions (float64), and RGB in [0, 1] where the file has colors."""

    xyz: Float[Tensor, "n 3"]
    rgb: Float[Tensor, "n 3"] | None


class Capture(NamedTuple):
    """Photos and points that a dataset's files list."""

    photos: tuple[PosedPhoto, ...]
    """Those that are there, sorted by name."""
    missing: tuple[str, ...]
    """The names of those that are not."""
    points: SparsePoints | None


def find_photo(folder: Path, relative: str, where: str) -> Path | None:
    """The file of a photo in a dataset: with a suffix where `relative` has none, and from images_2,
    images_4 or images_8 where images is not there; None if nothing is.

    Raises InputError if it is outside the folder.
    """
    first, slash, rest = relative.removeprefix("./").partition("/")
    names = [relative] + [f"{first}_{factor}/{rest}" for factor in reversed(REDUCED) if slash]
    for name in names:
        for suffix in ("", *SUFFIXES):
            file = file_inside(folder, name + suffix, where)
            if file.is_file():
                return file
    return None


def reduction(listed: str, found: str) -> int:
    """How many times smaller a photo is than the one that is listed, by their folders: 4 for
    images_4/a.jpg in place of images/a.jpg."""
    first, its = (name.removeprefix("./").partition("/")[0] for name in (listed, found))
    return next((factor for factor in REDUCED if its == f"{first}_{factor}"), 1)


def reduced_copy(photo: Path, images: Path, longest: int) -> Path:
    """The smallest copy of a photo below `images`, in images_8, _4 or _2, whose longer side has at
    least that many pixels; the photo itself where there is none."""
    if not photo.is_relative_to(images):
        return photo
    name = photo.relative_to(images)
    for factor in REDUCED:
        folder = images.with_name(f"{images.name}_{factor}")
        for copy in (folder / name, *((folder / name).with_suffix(end) for end in SUFFIXES)):
            if copy.is_file() and max(picture_size(copy)) >= longest:
                return copy
    return photo


def find_mask(masks: Path, name: str) -> Path | None:
    """The mask of the photo a/b.jpg in a folder: a/b.jpg.png, as COLMAP names it, or a/b.png."""
    photo = masks / name
    places = (photo.with_name(f"{photo.name}.png"), *(photo.with_suffix(end) for end in SUFFIXES))
    return next((place for place in places if place.is_file()), None)


def read_points(path: Path) -> SparsePoints | None:
    """The vertices of a point-cloud PLY; None if it has no rows. Raises InputError."""
    header = read_ply_header(path)
    vertex = header.element("vertex")
    if vertex is None or vertex.has_lists or not {"x", "y", "z"} <= set(vertex.names):
        raise InputError(f"{path} has no vertices with x, y and z: export the sparse points again")
    rows = next(element_blocks(path, header, "vertex", vertex.count or 1), None)
    if rows is None:
        return None
    xyz = _table(rows, ("x", "y", "z"))
    check_points(xyz, str(path))
    rgb = None
    if {"red", "green", "blue"} <= set(vertex.names):
        whole = rows.dtype["red"].kind in "iu"  # integers count to 255, floats to 1
        rgb = _table(rows, ("red", "green", "blue")).float() / (255 if whole else 1)
        rgb = rgb.clamp(0, 1)
    return SparsePoints(xyz, rgb)


def _table(rows: np.ndarray, names: tuple[str, ...]) -> Float[Tensor, "n c"]:
    return torch.from_numpy(np.stack([rows[name].astype(np.float64) for name in names], axis=-1))
