"""The frame of a scene that nerfstudio exported: dataparser_transforms.json beside it.

nerfstudio turns, moves and scales the world before it trains, and exports in that frame:
x' = scale (R x + t), where `transform` holds [R | t] and x is in the frame that the capture had
before its transforms.json applied `applied_transform` and `applied_scale`. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.dataparser import NAME
from gsedit.views.dataset import Dataset
from rasterizer.camera import Camera

_LEGACY = ((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0))
"""What files from COLMAP without `applied_transform` had applied (nerfstudio's own fallback)."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """x' = scale (rotation x + translation)."""

    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    scale: float

    def points(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """The points in the other frame."""
        moved = points.double() @ self.rotation.T + self.translation
        return (self.scale * moved).to(points)

    def camera(self, camera: Camera) -> Camera:
        """The camera in the other frame: the same picture of the moved scene."""
        pose = torch.eye(4, dtype=torch.float64)
        pose[:3, :3] = camera.rotation.double() @ self.rotation.T
        centre = self.scale * (self.rotation @ camera.centre.double() + self.translation)
        pose[:3, 3] = -pose[:3, :3] @ centre
        return replace(camera, world_to_camera=pose)


def in_export_frame(dataset: Dataset, data: Path, scene: Path) -> Dataset:
    """The dataset in the frame of a scene file with a dataparser_transforms.json beside it.

    `data` is what the dataset was read from. Without that file the dataset is returned as it is.
    Raises InputError for a file that is not nerfstudio's.
    """
    path = scene.with_name(NAME)
    if not path.is_file():
        return dataset
    change = _from_dataset(path, data)
    views = tuple(replace(view, camera=change.camera(view.camera)) for view in dataset.views)
    points = None if dataset.points is None else change.points(dataset.points)
    return replace(dataset, views=views, points=points)


def _from_dataset(path: Path, data: Path) -> Similarity:
    """From the frame of a dataset's own file to that of the export."""
    record = _parse(path)
    transform = _affine(record.get("transform"), f"{path}: transform")
    scale = _scale(record.get("scale"), f"{path}: scale")
    file = data / "transforms.json" if data.is_dir() else data
    if not file.is_file():  # a COLMAP folder: nothing was applied to it
        return Similarity(transform[:, :3], transform[:, 3], scale)
    own = _parse(file)
    legacy = _LEGACY if (file.parent / "colmap/sparse/0").exists() else torch.eye(4)[:3].tolist()
    applied = _affine(own.get("applied_transform", legacy), f"{file}: applied_transform")
    rotation = transform[:, :3] @ applied[:, :3].T
    translation = transform[:, 3] - rotation @ applied[:, 3]
    factor = scale / _scale(own.get("applied_scale", 1.0), f"{file}: applied_scale")
    return Similarity(rotation, translation, factor)


def _parse(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_bytes())
    except (OSError, json.JSONDecodeError, UnicodeDecodeError, RecursionError):
        record = None
    if not isinstance(record, dict):
        raise InputError(f"{path} is no JSON object: copy it again, or remove it")
    return record


def _affine(value: Any, where: str) -> Float[Tensor, "3 4"]:
    try:
        matrix = torch.tensor(value, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError):
        matrix = torch.zeros(0)
    if matrix.shape != (3, 4) or not matrix.isfinite().all():
        raise InputError(f"{where} is not 3x4 finite numbers: copy the file again, or remove it")
    gram = matrix[:, :3].T @ matrix[:, :3] - torch.eye(3, dtype=torch.float64)
    if gram.abs().max() > 1e-4 or matrix[:, :3].det() < 0:
        raise InputError(f"{where} holds no rotation: copy the file again, or remove it")
    return matrix


def _scale(value: Any, where: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 < value < float("inf"):
        raise InputError(f"{where} is not a positive number: copy the file again, or remove it")
    return float(value)
