"""Display colors (sRGB) as linear light and as CIE Lab, and back; numpy, nothing clipped.

`n` colors. sRGB and linear light are in [0, 1], Lab has L in [0, 100]. Values outside go through:
the curves are continued by their straight part below 0.
"""

from __future__ import annotations

import numpy as np

from gsedit.scene.shapes import Float

XYZ_OF_RGB = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
"""Linear light of the sRGB primaries (IEC 61966-2-1) as CIE XYZ, white D65."""
LUMINANCE = XYZ_OF_RGB[1]
"""Weights of linear red, green and blue (Rec. 709); their sum is 1."""
WHITE = XYZ_OF_RGB.sum(1)
"""XYZ of RGB (1, 1, 1): its Lab is (100, 0, 0)."""
KNEE = 6 / 29
"""Bend of the Lab curve: a cube root above KNEE^3, a straight line below (CIE 15)."""


def srgb_of_hex(digits: str) -> Float[np.ndarray, "3"]:
    """Display color of #rrggbb, with or without #. Raises ValueError for another text."""
    red, green, blue = bytes.fromhex(digits.removeprefix("#"))
    return np.array([red, green, blue]) / 255


def linear_of_srgb(srgb: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    """Linear light of display colors (IEC 61966-2-1)."""
    bent = ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(srgb > 0.04045, bent, srgb / 12.92)


def srgb_of_linear(linear: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    """Display colors of linear light."""
    bent = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear > 0.0031308, bent, linear * 12.92)


def lab_of_srgb(srgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """CIE Lab, white D65."""
    ratio = linear_of_srgb(srgb) @ XYZ_OF_RGB.T / WHITE
    f = np.where(ratio > KNEE**3, np.cbrt(ratio), ratio / (3 * KNEE**2) + 4 / 29)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)), -1)


def srgb_of_lab(lab: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Display colors of CIE Lab; outside [0, 1] where a display cannot show them."""
    y = (lab[..., 0] + 16) / 116
    f = np.stack((y + lab[..., 1] / 500, y, y - lab[..., 2] / 200), -1)
    ratio = np.where(f > KNEE, f**3, 3 * KNEE**2 * (f - 4 / 29))
    return srgb_of_linear(ratio * WHITE @ np.linalg.inv(XYZ_OF_RGB).T)
