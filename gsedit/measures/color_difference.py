"""Difference of colors as a person sees it: CIEDE2000 (CIE 142-2001)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64

HALF_CHROMA_7 = 25.0**7
"""Chroma, to the 7th power, at which grays are no longer stretched."""


def ciede2000(
    lab: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, " n"]:
    """CIEDE2000 between colors in CIE Lab; 1 is just seen. After Sharma, Wu and Dalal (2005)."""
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(np.asarray(c, float), -1, 0) for c in (lab, other))
    stretch = 1.5 - 0.5 * _saturating((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2)
    a1, a2 = stretch * a1, stretch * a2
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)) % 360, np.degrees(np.arctan2(b2, a2)) % 360
    turn = (h2 - h1 + 180) % 360 - 180
    gray = c1 * c2 == 0
    turn, hue = np.where(gray, 0, turn), np.where(gray, h1 + h2, h1 + turn / 2)
    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    off = np.square(lightness - 50)
    dl = (l2 - l1) / (1 + 0.015 * off / np.sqrt(20 + off))
    dc = (c2 - c1) / (1 + 0.045 * chroma)
    dh = 2 * np.sqrt(c1 * c2) * _sin(turn / 2) / (1 + 0.015 * chroma * _hue_weight(hue))
    swing = 30 * np.exp(-np.square(((hue - 275 + 180) % 360 - 180) / 25))
    mixed = -2 * _saturating(chroma) * _sin(2 * swing) * dc * dh
    return np.sqrt(np.maximum(dl**2 + dc**2 + dh**2 + mixed, 0))


def _saturating(chroma: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    return np.sqrt(chroma**7 / (chroma**7 + HALF_CHROMA_7))


def _hue_weight(hue: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    first = 1 - 0.17 * _cos(hue - 30) + 0.24 * _cos(2 * hue)
    return first + 0.32 * _cos(3 * hue + 6) - 0.20 * _cos(4 * hue - 63)


def _cos(degrees: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    return np.cos(np.radians(degrees))


def _sin(degrees: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    return np.sin(np.radians(degrees))
