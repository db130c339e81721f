"""nerfstudio's dataparser_transforms.json: the similarity from the capture's frame to the export's.

x' = scale (R x + t), where `transform` holds [R | t]. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py. `export_frame.py` does the same to cameras.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from gsedit.errors import InputError
from gsedit.files.atomic import atomic_path
from gsedit.files.inputs import beside, existing_file
from gsedit.files.similarity import IDENTITY, Similarity, similarity_of

NAME = "dataparser_transforms.json"
"""Beside a scene, it says that the scene is in the frame of its export."""

_LEGACY = ((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0))
"""What files from COLMAP without `applied_transform` had applied (nerfstudio's own fallback)."""


def read_dataparser(path: Path) -> Similarity:
    """Read a dataparser_transforms.json. Raises InputError for a file that is none."""
    existing_file(path)
    try:
        record = json.loads(path.read_bytes())
        matrix = np.eye(4)
        matrix[:3] = np.array(record["transform"], np.float64)
        scale = float(record["scale"])
        if not 0 < scale < float("inf"):
            raise ValueError("its scale is not positive")
        matrix[:3] *= scale
        return similarity_of(matrix)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{path} is no dataparser_transforms.json of nerfstudio ({type(error).__name__}: "
            f"{error}): give the file that lies beside config.yml"
        ) from None


def write_dataparser(similarity: Similarity, path: Path) -> None:
    """Write a dataparser_transforms.json, in the place of one that is there."""
    matrix = np.concatenate(
        (similarity.turn, similarity.translation[:, None] / similarity.scale), axis=1
    )
    record = {"transform": matrix.tolist(), "scale": similarity.scale}
    with atomic_path(path, overwrite=True) as temporary:
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
