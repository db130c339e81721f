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
from gsedit.files.pictures import picture_size
from gsedit.files.ply import read_ply
from gsedit.files.undistort import Lens


@dataclass(frozen=True, eq=False)
class PosedPhoto:
    """A photo's file with its pose and its lens."""

    name: str
    """Its file, relative to the folder of photos."""
    path: Path
    world_to_camera: Float[Tensor, "4 4"]
    """OpenCV axes, float64."""
    lens: Lens


class SparsePoints(NamedTuple):
    """World positions, and RGB in [0, 1] where the file has colours."""

    xyz: Float[Tensor, "n 3"]
    rgb: Float[Tensor, "n 3"] | None


def check_size(photo: PosedPhoto, where: str) -> None:
    """Raise InputError if the picture in the file is not the one that the lens describes."""
    width, height = picture_size(photo.path)
    lens = photo.lens
    if (width, height) != (lens.width, lens.height):
        raise InputError(
            f"{where}: {photo.path} is {width}x{height} pixels, its camera "
            f"{lens.width}x{lens.height}: use the photos that the poses were made from"
        )


def missing_photo(path: Path, where: str) -> InputError:
    """The error to raise for a photo that `where` names and that is not there."""
    return InputError(f"{where}: photo {path} does not exist: copy it there or remove its entry")


def read_points(path: Path) -> SparsePoints | None:
    """The vertices of a point-cloud PLY; None if it has no rows. Raises InputError."""
    vertex = read_ply(path).elements.get("vertex")
    if vertex is None or not {"x", "y", "z"} <= set(vertex.dtype.names or ()):
        raise InputError(f"{path} has no vertices with x, y and z: export the sparse points again")
    xyz = _table(vertex, ("x", "y", "z"))
    if not xyz.isfinite().all():
        row = int((~xyz.isfinite()).any(1).nonzero()[0])
        raise InputError(f"{path}: row {row} (from 0) is not finite: remove the row")
    rgb = None
    if {"red", "green", "blue"} <= set(vertex.dtype.names or ()):
        whole = vertex.dtype["red"].kind in "iu"  # integers count to 255, floats to 1
        rgb = (_table(vertex, ("red", "green", "blue")) / (255 if whole else 1)).clamp(0, 1)
    return SparsePoints(xyz, rgb) if len(vertex) else None


def _table(rows: np.ndarray, names: tuple[str, ...]) -> Float[Tensor, "n c"]:
    return torch.from_numpy(np.stack([rows[name].astype(np.float32) for name in names], axis=-1))
