"""The frame of a scene that nerfstudio exported: dataparser_transforms.json beside it.

nerfstudio turns, moves and scales the world before it trains, and exports in that frame:
x' = scale (R x + t), where `transform` holds [R | t], and x is in the frame that the capture had
before its transforms.json applied `applied_transform` and `applied_scale`. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from gsedit.errors import InputError
from gsedit.formats.limits import MAX_POSITION
from gsedit.run.atomic import atomic_path, beside_or_shared
from gsedit.run.inputs import beside
from gsedit.run.json_files import number, numbers, object_of, read_json
from gsedit.scene.similarity import IDENTITY, Similarity, moved_camera, similarity_of
from gsedit.views.dataset import Dataset

NAME = "dataparser_transforms.json"
"""Beside a scene, it says that the scene is in the frame of its export."""

_LEGACY = ((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0))
"""Transform that files from COLMAP without `applied_transform` had applied (nerfstudio's fallback).
"""

_SCALE = number(1e-9, 1e9)
_MATRIX = numbers(3, 4, most=MAX_POSITION)
_EXPORTED = object_of({"transform": _MATRIX, "scale": _SCALE})
_APPLIED = object_of({}, {"applied_transform": _MATRIX, "applied_scale": _SCALE})


def read_dataparser(path: Path) -> Similarity:
    """Read a dataparser_transforms.json. Raises InputError for a file that is none."""
    advice = "give nerfstudio's file that lies beside config.yml"
    record = read_json(path, _EXPORTED, advice=advice)
    matrix = np.eye(4)
    matrix[:3] = record["transform"] * record["scale"]
    try:
        return similarity_of(matrix)
    except ValueError as error:
        raise InputError(f"{path}: transform is none ({error}): {advice}") from None


def write_dataparser(similarity: Similarity, path: Path, *, overwrite: bool = False) -> None:
    """Write a dataparser_transforms.json. Raises what `atomic_path` raises."""
    matrix = np.concatenate(
        (similarity.turn, similarity.translation[:, None] / similarity.scale), axis=1
    )
    record = {"transform": matrix.tolist(), "scale": similarity.scale}
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")


def dataparser_file(scene: Path) -> Path | None:
    """SCENE.dataparser_transforms.json, or dataparser_transforms.json beside a scene; else None."""
    places = (beside(scene, NAME), scene.with_name(NAME))
    return next((place for place in places if place.is_file()), None)


def applied_by(data: Path) -> tuple[Similarity, float]:
    """The transform and the scale that a dataset's file says were applied to its capture; none
    were to a COLMAP folder.

    Raises InputError for a file that is not nerfstudio's.
    """
    file = data / "transforms.json" if data.is_dir() else data
    if not file.is_file():
        return IDENTITY, 1.0
    record = read_json(file, _APPLIED, advice="copy the file again")
    legacy = _LEGACY if (file.parent / "colmap/sparse/0").exists() else np.eye(4)[:3]
    try:
        applied = similarity_of(np.array(record.get("applied_transform", legacy), np.float64))
    except ValueError as error:
        raise InputError(
            f"{file}: applied_transform is no similarity ({error}): copy the file again"
        ) from None
    return applied, record.get("applied_scale", 1.0)


def in_export_frame(dataset: Dataset, data: Path, scene: Path) -> Dataset:
    """The dataset in the frame of a scene file with a dataparser_transforms.json beside it.

    `data` is what the dataset was read from. Without that file the scene is taken to be in the
    frame of the dataset's files. Raises InputError for a file that is not nerfstudio's.
    """
    path = dataparser_file(scene)
    back = Similarity(np.eye(3), 1.0, np.array(dataset.offset))
    if path is None:
        return moved(dataset, back) if any(dataset.offset) else dataset
    turned, factor = applied_by(data)
    # its own transform and scale hold those that were applied to the capture
    unscaled = Similarity(np.eye(3), 1 / factor, np.zeros(3))
    return moved(dataset, unscaled.after(read_dataparser(path)).after(turned.inverse).after(back))


def moved(dataset: Dataset, change: Similarity) -> Dataset:
    """The dataset in another frame, which no longer is that of its files less the offset."""
    views = tuple(view.seen_by(moved_camera(view.camera, change)) for view in dataset.views)
    points = dataset.points
    if points is not None:
        points = torch.from_numpy(change.points(points.numpy())).to(points)
    return replace(dataset, views=views, points=points, offset=(0.0, 0.0, 0.0))


def frame_beside(
    dataset: Dataset, data: Path, scene: Path, start: Path | None = None
) -> Similarity | None:
    """Return how the frame of a scene that is fitted to a dataset came from that of its capture.

    It is the frame of the scene `start` where a file beside that says which it is. None where it is
    the frame of the dataset's files and no file beside the fitted scene says otherwise.
    """
    if start is not None and (file := dataparser_file(start)) is not None:
        return read_dataparser(file)
    if dataparser_file(scene) is None and not any(dataset.offset):
        return None
    turned, factor = applied_by(data)
    scaled = Similarity(np.eye(3), factor, np.zeros(3))
    shift = Similarity(np.eye(3), 1.0, -np.array(dataset.offset))
    return scaled.after(shift).after(turned)


def frame_place(change: Similarity, scene: Path, *, overwrite: bool = False) -> Path:
    """Return the file beside a scene that says its frame: one that is there, or where to write it.

    A dataparser_transforms.json of another frame stays as it is: the file is
    SCENE.dataparser_transforms.json then, which `dataparser_file` prefers. Raises UsageError where
    that says another frame, unless `overwrite`.
    """
    own, shared = beside(scene, NAME), scene.with_name(NAME)
    return beside_or_shared(own, shared, partial(_says, change), overwrite=overwrite)


def write_export_frame(change: Similarity, scene: Path, *, overwrite: bool = False) -> Path:
    """Write the frame of a scene beside it, unless a file says it; return the file's path.

    Raises what `frame_place` raises.
    """
    path = frame_place(change, scene, overwrite=overwrite)
    if not _says(change, path):
        write_dataparser(change, path, overwrite=overwrite)
    return path


def _says(change: Similarity, path: Path) -> bool:
    """Return whether a file holds this frame; False where it is none."""
    try:
        return np.allclose(read_dataparser(path).matrix, change.matrix, rtol=1e-12)
    except InputError:
        return False
