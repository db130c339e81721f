"""The frame of a scene that nerfstudio exported: dataparser_transforms.json beside it.

nerfstudio turns, moves and scales the world before it trains, and exports in that frame (see
`dataparser.py`); x there is in the frame that the capture had before its transforms.json applied
`applied_transform` and `applied_scale`. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from gsedit.errors import InputError
from gsedit.files.dataparser import NAME, read_dataparser
from gsedit.files.moved_cameras import moved_camera
from gsedit.files.similarity import IDENTITY, Similarity, similarity_of
from gsedit.views.dataset import Dataset

_LEGACY = ((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0))
"""What files from COLMAP without `applied_transform` had applied (nerfstudio's own fallback)."""


def in_export_frame(dataset: Dataset, data: Path, scene: Path) -> Dataset:
    """The dataset in the frame of a scene file with a dataparser_transforms.json beside it.

    `data` is what the dataset was read from. Without that file the dataset is returned as it is.
    Raises InputError for a file that is not nerfstudio's.
    """
    path = scene.with_name(NAME)
    if not path.is_file():
        return dataset
    turned, factor = applied_by(data)
    # its own transform and scale hold those that were applied to the capture
    unscaled = Similarity(np.eye(3), 1 / factor, np.zeros(3))
    change = unscaled.after(read_dataparser(path)).after(turned.inverse)
    views = tuple(replace(view, camera=moved_camera(view.camera, change)) for view in dataset.views)
    points = dataset.points
    if points is not None:
        points = torch.from_numpy(change.points(points.numpy())).to(points)
    return replace(dataset, views=views, points=points)


def applied_by(data: Path) -> tuple[Similarity, float]:
    """The transform and the scale that a dataset's file says were applied to its capture; none
    were to a COLMAP folder.

    Raises InputError for a file that is not nerfstudio's.
    """
    file = data / "transforms.json" if data.is_dir() else data
    if not file.is_file():
        return IDENTITY, 1.0
    try:
        record = json.loads(file.read_bytes())
        legacy = _LEGACY if (file.parent / "colmap/sparse/0").exists() else np.eye(4)[:3]
        matrix = np.array(record.get("applied_transform", legacy), np.float64)
        scale = float(record.get("applied_scale", 1.0))
        if not 0 < scale < float("inf"):
            raise ValueError("its applied_scale is not positive")
        return similarity_of(matrix), scale
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{file}: applied_transform is no similarity ({error}): copy the file again"
        ) from None
