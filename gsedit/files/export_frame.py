"""The frame of a scene that nerfstudio exported: dataparser_transforms.json beside it.

nerfstudio turns, moves and scales the world before it trains, and exports in that frame (see
`dataparser.py`); x there is in the frame that the capture had before its transforms.json applied
`applied_transform` and `applied_scale`. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from gsedit.files.dataparser import (
    NAME,
    applied_by,
    dataparser_file,
    read_dataparser,
    write_dataparser,
)
from gsedit.files.inputs import beside
from gsedit.files.moved_cameras import moved_camera
from gsedit.files.similarity import Similarity
from gsedit.views.dataset import Dataset


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


def write_export_frame(dataset: Dataset, data: Path, scene: Path) -> Path | None:
    """Write how the frame of a scene that was fitted to a dataset came from that of its capture,
    beside the scene; the path of the file.

    Nothing is written, and None returned, where the frame is that of the dataset's files and no
    file beside the scene says otherwise. A dataparser_transforms.json of another frame stays as it
    is: the file is SCENE.dataparser_transforms.json then, which `dataparser_file` prefers.
    """
    turned, factor = applied_by(data)
    scaled = Similarity(np.eye(3), factor, np.zeros(3))
    shift = Similarity(np.eye(3), 1.0, -np.array(dataset.offset))
    change = scaled.after(shift).after(turned)
    if dataparser_file(scene) is None and not any(dataset.offset):
        return None
    return _written(change, scene)


def copy_export_frame(source: Path, scene: Path) -> Path | None:
    """Write the frame of another scene, if a file beside it says which it is, beside a scene in the
    same frame; the path of the file, see `write_export_frame`."""
    file = dataparser_file(source)
    return None if file is None else _written(read_dataparser(file), scene)


def _written(change: Similarity, scene: Path) -> Path:
    """The file beside a scene that says how its frame came about: one that is there, or new."""
    found = dataparser_file(scene)
    if found is not None and np.allclose(read_dataparser(found).matrix, change.matrix, rtol=1e-12):
        return found
    path = scene.with_name(NAME) if found is None else beside(scene, NAME)
    write_dataparser(change, path)
    return path
