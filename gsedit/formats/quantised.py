"""Colors and opacities of 8 bits, as the quantized formats store them."""

from __future__ import annotations

import numpy as np

from gsedit.scene.table import SplatTable

LOGIT_MAX = 15.0
"""These formats store opacity in 8 bits, and 255 means 1, whose logit is infinite. The sigmoid of
15 is 1 - 3e-7: about the largest logit at which float32 still has a gradient."""


def finite_logits(table: SplatTable) -> SplatTable:
    """The table with the logits of its opacities between -LOGIT_MAX and LOGIT_MAX."""
    return table.replace(logit_opacities=table.logit_opacities.clip(-LOGIT_MAX, LOGIT_MAX))


def bytes_of(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1] as whole numbers of 8 bits, rounded; others as the nearest end."""
    return (values.clip(0, 1) * 255 + np.float32(0.5)).astype(np.uint8)
