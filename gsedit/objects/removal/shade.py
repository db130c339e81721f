"""The shadow that an object casts on what it stands on, told from the surface's own darkness.

The surface around the object is made up from what is farther off, as if it were unknown: where it
is darker than that, evenly in all colors or fading out, the object's shadow lies. `h w` cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

from gsedit.objects.removal.cells import away_from, mean_around, opened, touching, widened
from gsedit.objects.removal.complete import complete

REACH = 0.7
"""Farthest that a shadow reaches from what casts it, of its size."""
CONTACT = 0.35
"""Farthest that a shadow reaches where little is touched, of the farthest that is asked."""
NEAREST = 0.65
"""Largest share of what is known that is asked for a shadow: the rest says what is usual."""
SHADED = 0.94
"""Light, of what is usual, below which there is shadow."""
DIM, USUAL = 0.85, 0.6
"""Light beside it that is surely dim, of the quantile of all light that is usual."""
WIDE = (4.0, 0.15)
"""Standard deviation over which light is averaged for that, at least in cells, and of the size of
what casts it: wider than a texture's own dark parts."""
DEEP = 0.55
"""Light, of what is usual, below which nothing of the surface can be brought back."""
THIN = 0.08
"""Half of the width, of the size of what casts it, up to which what is dark is no shadow: a crease
between two surfaces, or a bridge to another's shadow."""
CLOSER = 2.0
"""How much nearer than the object what else stands there is to what is in its own shadow."""
BLUR = 0.1
"""Standard deviation over which light is averaged, of the size of what casts it."""
GRAY = 1.2
"""Largest ratio of the light of two colors in a shadow that ends sharply: else it is paint."""
SOFT = 0.82
"""Light at the border of a shadow, of what is usual, from which it fades out."""


@dataclass(frozen=True, eq=False)
class Shade:
    """The light that a shadow left, of what is usual."""

    light: Float[np.ndarray, "h w 3"]
    """In (0, 1]; 1 where there is no shadow."""
    deep: Bool[np.ndarray, "h w"]
    """Cells too dark for anything to be brought back."""


def find_shade(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    caster: Bool[np.ndarray, "h w"],
    others: Bool[np.ndarray, "h w"],
    farthest: float,
) -> Shade:
    """The shadow around what casts it, on what is known of a surface; `farthest` cells from it.

    What is nearer to `others`, that stand there too, is in their shadow.
    """
    none = Shade(np.ones_like(picture), np.zeros_like(hole))
    source = hole | caster
    if not caster.any() or not (known & ~source).any():
        return none
    size = float(np.sqrt(source.sum()))
    away = away_from(source)
    reach = max(REACH * size, CONTACT * farthest)
    reach = min(reach, float(np.quantile(away[known], NEAREST)))
    sigma, seen = max(1.0, BLUR * size), known.astype(np.float64)
    mean = mean_around(picture, seen, sigma)
    near = known & (away <= reach)
    wide = mean_around(picture, seen, max(WIDE[0], WIDE[1] * size)).mean(-1)
    dim = wide < DIM * np.quantile(wide[known], USUAL)
    near |= touching(known & dim & (away <= farthest), source | near)
    far = known & ~near
    if not near.any() or not far.any():
        return none
    usual = complete(picture, far, hole | near).picture
    light = mean / np.maximum(mean_around(usual, seen, sigma), 1e-3)
    dark = near & (light.mean(-1) < SHADED)
    dark &= opened(dark | source, max(1, round(THIN * size)))
    if others.any():
        dark &= CLOSER * away_from(others) > away
    shadow = touching(dark, source)
    if not shadow.any() or not _cast(light, shadow, known & ~shadow):
        return none
    light = _sharp(picture, usual, known, light, sigma)
    light = np.where(shadow[..., None], light.clip(0.05, 1.0), 1.0)
    fading = mean_around(light, seen, sigma / 2).clip(0.05, 1.0)
    deep = shadow & (fading.mean(-1) < DEEP)
    return Shade(np.where(known[..., None], fading, 1.0), deep)


def _sharp(
    picture: Float[np.ndarray, "h w 3"],
    usual: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    light: Float[np.ndarray, "h w 3"],
    sigma: float,
) -> Float[np.ndarray, "h w 3"]:
    """Light with the edges of shadows: medians keep them, means do not."""
    seen = known.astype(np.float64)
    ratio = mean_around(picture, seen, 1.0) / np.maximum(mean_around(usual, seen, 1.0), 1e-3)
    width = 2 * round(sigma) + 1
    return median_filter(np.where(known[..., None], ratio, light), (width, width, 1))


def _cast(
    light: Float[np.ndarray, "h w 3"],
    shadow: Bool[np.ndarray, "h w"],
    lit: Bool[np.ndarray, "h w"],
) -> bool:
    """Whether what is dark is a shadow: it fades out, or takes all colors alike."""
    rim = shadow & widened(lit, 2)
    if not rim.any() or np.median(light[rim].mean(-1)) > SOFT:
        return True
    channels = np.median(light[shadow], 0)
    return bool(channels.max() < GRAY * channels.min())
