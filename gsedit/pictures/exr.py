"""OpenEXR pictures: float32 channels by name, compressed without loss (ZIP).

Names and meaning: https://openexr.com/en/latest/TechnicalIntroduction.html. R, G, B are linear
light, as every reader of the format takes them; A is alpha, with which they are premultiplied; Z is
depth.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gsedit.runs.environment import load_extra
from gsedit.storage.atomic import atomic_path

Channels = Mapping[str, Float[np.ndarray, "h w"]]


def write_exr(
    channels: Channels, path: str | Path, *, comments: str = "", overwrite: bool = False
) -> None:
    """Write channels of one size, float32, whole or not at all. Raises what `atomic_path` raises,
    GseditError without the package OpenEXR.
    """
    openexr = _import()
    header: dict[str, Any] = {
        "compression": openexr.ZIP_COMPRESSION,
        "type": openexr.scanlineimage,
    }
    if comments:
        header["comments"] = comments
    arrays = {
        name: np.ascontiguousarray(values, dtype=np.float32) for name, values in channels.items()
    }
    with atomic_path(path, overwrite=overwrite) as temporary:
        try:
            openexr.File(header, arrays).write(str(temporary))
        except RuntimeError as error:  # a full disk too
            raise OSError(str(error)) from error


def _import() -> Any:
    return load_extra("OpenEXR", "an EXR file", "write .npy")
