"""What the quantised formats share: opacities of 8 bits, and gsply, which unpacks two of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import InputError
from gsedit.files.table import SplatTable

LOGIT_MAX = 15.0
"""These formats store opacity in 8 bits, and 255 means 1, whose logit is infinite. The sigmoid of
15 is 1 - 3e-7: about the largest logit at which float32 still has a gradient."""


def finite_logits(table: SplatTable) -> SplatTable:
    """The table with the logits of its opacities between -LOGIT_MAX and LOGIT_MAX."""
    return table.replace(logit_opacities=table.logit_opacities.clip(-LOGIT_MAX, LOGIT_MAX))


def bytes_of(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1] as whole numbers of 8 bits, rounded; others as the nearest end."""
    return (values.clip(0, 1) * 255 + np.float32(0.5)).astype(np.uint8)


def unpacked(path: Path, read: Callable[[], Any]) -> SplatTable:
    """The scene that gsply reads from a file. Raises InputError for a damaged one."""
    try:
        return finite_logits(from_gsply(read()))
    except (ValueError, MemoryError, OverflowError, KeyError, IndexError) as error:
        reason = str(error).split("\n")[0].removesuffix(f": {path}")
        if "zstandard" in reason:
            move = "run `pip install zstandard`, or save it as SPZ version 3"
            raise InputError(f"{path} is SPZ version 4: {move}") from None
        raise InputError(f"{path} cannot be unpacked ({reason}): export it again") from None


def from_gsply(data: Any) -> SplatTable:
    """The table of gsply's GSData: log scales, logit opacities, SH in two parts."""
    bands = [data.sh0[:, None]]
    if data.shN is not None:  # None from .spz of degree 0, an empty array from .ply
        bands.append(data.shN.reshape(len(data), data.shN.shape[1], 3))
    sh = np.concatenate(bands, axis=1)
    arrays = (data.means, data.quats, data.scales, data.opacities.reshape(-1), sh)
    # copied: the arrays are views into one table, which would stay in memory
    means, quats, scales, opacities, sh = (np.array(a, np.float32, order="C") for a in arrays)
    return SplatTable(means, quats, scales, opacities, sh)


def to_gsply(table: SplatTable) -> Any:
    """The table as gsply writes it."""
    from gsply import GSData

    norms = np.linalg.norm(table.quats, axis=1, keepdims=True)  # smallest-three packing needs 1
    fields = (table.means, table.log_scales, table.quats / norms, table.logit_opacities)
    dc, rest = np.ascontiguousarray(table.sh[:, 0]), np.ascontiguousarray(table.sh[:, 1:])
    return GSData.from_arrays(*fields, dc, rest, format="ply")
