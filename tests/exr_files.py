"""Read OpenEXR pictures that `gsedit render` wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float


def read_exr(path: Path) -> dict[str, Float[np.ndarray, "h w"]]:
    """All channels of a file, as stored."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}
