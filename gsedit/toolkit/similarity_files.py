"""Similarities as files: {"matrix": 4x4, "scale", "rotation_wxyz", "translation"} as JSON.

Read too: a .npy and a text of 4x4 or 3x4 numbers for column vectors.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import InputError
from gsedit.formats.flags import mapped_array
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file
from gsedit.run.json_files import read_json
from gsedit.scene.quaternions import quaternion_of
from gsedit.scene.similarity import Similarity, similarity_of


def record_of(similarity: Similarity) -> dict[str, Any]:
    """For a JSON file; of a mirroring one the quaternion is that of -turn."""
    turn = -similarity.turn if similarity.mirrors else similarity.turn
    return {
        "matrix": similarity.matrix.tolist(),
        "scale": similarity.scale,
        "rotation_wxyz": quaternion_of(turn).tolist(),
        "mirrors": similarity.mirrors,
        "translation": similarity.translation.tolist(),
    }


def write_similarity(similarity: Similarity, path: Path, *, overwrite: bool = False) -> None:
    """Write a .json. Raises UsageError if the file exists (and not `overwrite`)."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(json.dumps(record_of(similarity), indent=1) + "\n")


def read_similarity(path: Path) -> Similarity:
    """Read a .json, a .npy or a text. Raises InputError for what is no similarity."""
    existing_file(path)
    try:
        if path.suffix == ".json":
            record = read_json(path)
            matrix = record["matrix"] if isinstance(record, dict) else record
        elif path.suffix == ".npy":
            matrix = mapped_array(path)
        else:
            matrix = np.loadtxt(path, ndmin=2)
        return similarity_of(np.array(matrix, np.float64))
    except (ValueError, KeyError, TypeError, EOFError, OverflowError) as error:
        reason = str(error) or type(error).__name__
        raise InputError(
            f"{path} holds no similarity ({reason}): give 4x4 numbers, or a file of --save"
        ) from None
