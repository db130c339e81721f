"""nerfstudio's dataparser_transforms.json: the similarity from the capture's frame to the export's.

x' = scale (R x + t), where `transform` holds [R | t]. Source:
nerfstudio/data/dataparsers/nerfstudio_dataparser.py. `export_frame.py` does the same to cameras.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from gsedit.errors import InputError
from gsedit.files.inputs import existing_file
from gsedit.files.similarity import Similarity, similarity_of

NAME = "dataparser_transforms.json"
"""Beside a scene, it says that the scene is in the frame of its export."""


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
