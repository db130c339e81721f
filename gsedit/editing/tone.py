"""Tone route: brightness, contrast, saturation and their like, affine in display colors and so
exact from every direction. The matrices are those of gsedit.toolkit.grade and of the W3C's filter
effects (https://www.w3.org/TR/filter-effects-1)."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, log2

import numpy as np
from jaxtyping import Bool

from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.table import SplatTable
from gsedit.toolkit.grade import COLDEST, GAMMA, HOTTEST, NEUTRAL, Affine, Grade
from gsedit.toolkit.recolor import recolored
from gsedit.words.colors import parse_hex
from gsedit.words.instruction import MOST

DEFAULT_SHARE = 0.3
"""Share of a change without a number: plainly seen, and far from the ends."""
WHOLE = 1.0
"""Share of a change that is all or nothing: grayscale, sepia, negative."""
DARKEST_STOPS = -20.0
"""Stops that stand for no light: a display color of 1 becomes half of an 8-bit step."""
WARMEST = 4.0
"""Factor of kelvin at a share of 1, its inverse at -1: the range of `Grade.temperature`."""
SEPIA = ((0.393, 0.769, 0.189), (0.349, 0.686, 0.168), (0.272, 0.534, 0.131))


def toned(
    table: SplatTable,
    inside: Bool[np.ndarray, " n"],
    name: str,
    amount: float | None,
    color: str | None = None,
) -> SplatTable:
    """Change the tone of the Gaussians inside; the others' coefficients are the same bits.

    Raises UsageError for an unknown name, an amount out of range, or a color that is none.
    """
    return recolored(table, inside, tone_map(name, amount, color))


def tone_map(name: str, amount: float | None, color: str | None = None) -> Affine:
    """The map of display colors of a tone and its signed share. Raises as `toned`."""
    if name not in TONES:
        raise UsageError(f"there is no tone {name!r}: choose one of {', '.join(TONES)}")
    make, default, least = TONES[name]
    share = default if amount is None else amount
    most = MOST["tone"]
    if not (isfinite(share) and least <= share <= most):
        raise UsageError(
            f"{name} by {share:+.0%} is out of range: say a share from {least:+.0%} to {most:+.0%}"
        )
    if name == "hue" and color is not None:
        return _tint(share, color)
    return make(share)


def _brightness(share: float) -> Affine:
    """Display colors times 1 + share."""
    return Grade(exposure=max(GAMMA * log2(max(1 + share, 1e-9)), DARKEST_STOPS)).affine


def _warmth(share: float) -> Affine:
    kelvin = NEUTRAL * WARMEST**share
    return Grade(temperature=min(max(kelvin, COLDEST), HOTTEST)).affine


def _mixed(matrix: np.ndarray, offset: np.ndarray, share: float) -> Affine:
    """The share of the way from no change to an affine map."""
    share = min(share, 1.0)
    return Affine((1 - share) * np.eye(3) + share * matrix, share * offset)


def _tint(share: float, color: str) -> Affine:
    """Mix colors with their luma in the color, which keeps the luma of gray."""
    weights = LUMINANCE / LUMINANCE.sum()
    target = np.maximum(parse_hex(color), 1 / 255)
    return _mixed(np.outer(target / (weights @ target), weights), np.zeros(3), share)


TONES: dict[str, tuple[Callable[[float], Affine], float, float]] = {
    "brightness": (_brightness, DEFAULT_SHARE, -1.0),
    "contrast": (lambda share: Grade(contrast=1 + share).affine, DEFAULT_SHARE, -1.0),
    "saturation": (lambda share: Grade(saturation=1 + share).affine, DEFAULT_SHARE, -1.0),
    "warmth": (_warmth, DEFAULT_SHARE, -1.0),
    "hue": (lambda share: Grade(hue=360 * share).affine, DEFAULT_SHARE, -1.0),
    "grayscale": (lambda share: Grade(saturation=1 - min(share, 1)).affine, WHOLE, 0.0),
    "sepia": (lambda share: _mixed(np.array(SEPIA), np.zeros(3), share), WHOLE, 0.0),
    "negative": (lambda share: _mixed(-np.eye(3), np.ones(3), share), WHOLE, 0.0),
}
"""Tones by name: (map of a share, share without a number, least share)."""
