"""Colors, opacities and rotations of few bits, as the quantized formats store them."""

from __future__ import annotations

import numpy as np

LOGIT_MAX = 15.0
"""These formats store opacity in 8 bits, and 255 means 1, whose logit is infinite. The sigmoid of
15 is 1 - 3e-7: about the largest logit at which float32 still has a gradient."""


def bytes_of(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1] as whole numbers of 8 bits, rounded; others as the nearest end."""
    return (values.clip(0, 1) * 255 + np.float32(0.5)).astype(np.uint8)


def logits_of(opacities: np.ndarray) -> np.ndarray:
    """Logits of opacities, between -LOGIT_MAX and LOGIT_MAX; NaN outside [0, 1]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(opacities / (1 - opacities)).clip(-LOGIT_MAX, LOGIT_MAX)


def log_scales_of(scales: np.ndarray) -> np.ndarray:
    """Logarithms of scales; of 0, which exporters round tiny ones to, that of the smallest normal
    float. NaN below 0."""
    with np.errstate(divide="ignore", invalid="ignore"):  # damaged rows are found later
        return np.log(np.where(scales == 0, np.finfo(np.float32).tiny, scales))


THE_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""The components of a quaternion beside each."""


def smallest_three(quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The three smaller components of the unit quaternions (n 4) in their order, where the largest
    is positive; and the place of the largest."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # damaged rows: told later
        unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    largest = np.abs(unit).argmax(1)
    rows = np.arange(len(unit))
    others = unit[rows[:, None], THE_OTHERS[largest]] * np.sign(unit[rows, largest])[:, None]
    return others, largest


def from_smallest_three(others: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """The inverse of `smallest_three`: unit quaternions, float32."""
    quats = np.empty((len(others), 4), np.float32)
    rows = np.arange(len(others))
    quats[rows[:, None], THE_OTHERS[largest]] = others
    quats[rows, largest] = np.sqrt((1 - (others * others).sum(1)).clip(0))
    return quats
