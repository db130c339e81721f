"""Paint route: one base color on Gaussians, under the light that the scene has.

The luminance of a Gaussian is taken as light times surface. Its mean over neighbors in space is the
light (low frequencies); its ratio to that mean is kept within limits, so that carved detail stays
and painted texture goes. Patches of paint wider than the mean are taken for light: a white belly
stays lighter. `m` Gaussians that are painted, `k` SH coefficients a channel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from gsedit.scene.color_space import LUMINANCE, linear_of_srgb, srgb_of_linear
from gsedit.scene.neighbors import nearest
from gsedit.scene.table import SplatTable
from rasterizer.numerics import SH_DC

SMOOTHING_ROUNDS = 24
"""Means over the nearest neighbors, one after the other: together they reach about five times as
far as the neighbors are."""
DETAIL = (0.5, 1.25)
"""Least and largest ratio to the surroundings, in linear light: dark carving is deep, bright specks
are paint or noise."""
SHADE = (0.15, 3.0)
"""Least and largest light against its median: beyond, it is another paint."""
BLACKEST = 0.006
"""Least share of the light that paint reflects: less would be a hole in the picture."""
LIT = 0.8
"""Quantile of the light at which no channel may pass the display's white: white paint keeps its
shading."""
LARGEST_GAIN = 3.0
"""Largest factor of the bands above 0: those of a nearly black Gaussian are noise."""
DIMMEST_LIGHT = 0.25
"""Least share of the asked color that is left in a dark scene."""
BRIGHT_SCENE = 0.4
"""Linear luminance of the brighter parts of a well lit picture."""
BRIGHTER_PARTS = 0.9
"""Quantile of the luminance of a scene that is compared with BRIGHT_SCENE."""


@dataclass(frozen=True)
class Finish:
    """How a coat of paint shines."""

    shine: float
    """Factor of the bands above 0, which hold what depends on the direction."""
    tinted: bool
    """Whether reflections take the paint's color, as on metal, or stay the light's."""


FINISHES = {
    "matte": Finish(0.0, True),
    "glossy": Finish(1.0, False),
    "metallic": Finish(1.0, True),
}
SATIN = Finish(0.5, True)
"""Finish of paint that names none."""


def finish_of(name: str) -> Finish:
    """The finish that one of the words names; SATIN without any."""
    return next((FINISHES[word] for word in name.lower().split() if word in FINISHES), SATIN)


def painted(
    table: SplatTable,
    inside: Bool[np.ndarray, " n"],
    color: Float64[np.ndarray, "3"],
    finish: Finish = SATIN,
    seen: Float[np.ndarray, " n"] | None = None,
) -> SplatTable:
    """Paint the Gaussians inside in a display color; the others' coefficients are the same bits.

    `seen` says how much of pictures each Gaussian fills; None: its opacity times its area.
    """
    part = table[inside]
    weights = visible_area(part) if seen is None else seen[inside].astype(np.float64)
    before = np.clip(part.colors.astype(np.float64), 0, 1)
    after = repainted(part, before, weights + 1e-12, color, scene_light(table))
    sh = table.sh.copy()
    sh[inside] = _coefficients(part.sh, before, after, finish)
    return table.replace(sh=sh)


def repainted(
    part: SplatTable,
    before: Float64[np.ndarray, "m 3"],
    weights: Float64[np.ndarray, " m"],
    color: Float64[np.ndarray, "3"],
    light: float,
) -> Float64[np.ndarray, "m 3"]:
    """Display colors in which the mean is the color under a light in (0, 1]."""
    base = np.maximum(linear_of_srgb(color), BLACKEST)
    shade = shading(part.means, linear_of_srgb(before) @ LUMINANCE, weights)
    factor = light * _exposure(shade, weights, base)
    return srgb_of_linear(np.minimum(factor * shade[:, None] * base, 1))


def shading(
    means: Float[np.ndarray, "m 3"],
    luminance: Float64[np.ndarray, " m"],
    weights: Float64[np.ndarray, " m"],
) -> Float64[np.ndarray, " m"]:
    """The light on each Gaussian with its carved detail, against the median light."""
    smooth = spatial_mean(means, luminance, weights)
    middle = max(float(np.median(smooth)), 1e-4)
    detail = np.clip(luminance / np.maximum(smooth, 1e-4), *DETAIL)
    return np.clip(smooth / middle, *SHADE) * detail


def spatial_mean(
    means: Float[np.ndarray, "m 3"],
    values: Float64[np.ndarray, " m"],
    weights: Float64[np.ndarray, " m"],
) -> Float64[np.ndarray, " m"]:
    """Weighted means of values over neighbors in space."""
    _, rows = nearest(means)
    total, mass = values * weights, weights
    for _ in range(SMOOTHING_ROUNDS):
        total = (total + total[rows].sum(1)) / (1 + rows.shape[1])
        mass = (mass + mass[rows].sum(1)) / (1 + rows.shape[1])
    return total / np.maximum(mass, 1e-12)


def visible_area(table: SplatTable) -> Float64[np.ndarray, " n"]:
    """Opacity times the area of the largest face: how much of a picture a Gaussian fills."""
    ordered = np.sort(table.scales.astype(np.float64), 1)
    return table.opacities * ordered[:, 1] * ordered[:, 2]


def scene_light(table: SplatTable) -> float:
    """How well lit a scene is, from DIMMEST_LIGHT to 1 for one whose brighter parts are as in a
    picture by day."""
    seen = table.opacities > 0.5
    if not seen.any():
        return 1.0
    luminance = linear_of_srgb(np.clip(table.colors[seen], 0, 1)) @ LUMINANCE
    return float(np.clip(np.quantile(luminance, BRIGHTER_PARTS) / BRIGHT_SCENE, DIMMEST_LIGHT, 1))


def _exposure(
    shade: Float64[np.ndarray, " m"],
    weights: Float64[np.ndarray, " m"],
    base: Float64[np.ndarray, "3"],
) -> float:
    """The factor at which the mean display color, by weight, is the base color; less for colors
    that would lose their shading in the display's white."""
    wanted = srgb_of_linear(base) @ LUMINANCE
    sample = srgb_of_linear(shade[:, None] * base) @ LUMINANCE
    found = np.average(sample, weights=weights)
    factor = (wanted / max(float(found), 1e-6)) ** 2.4
    order = np.argsort(shade)
    reached = np.cumsum(weights[order])
    lit = shade[order][np.searchsorted(reached, LIT * reached[-1])]
    return float(min(factor, 1 / max(lit * base.max(), 1e-6)))


def _coefficients(
    sh: Float[np.ndarray, "m k 3"],
    before: Float64[np.ndarray, "m 3"],
    after: Float64[np.ndarray, "m 3"],
    finish: Finish,
) -> Float64[np.ndarray, "m k 3"]:
    """SH of the new colors; what depends on the direction is scaled as the luma is, and tinted."""
    new = np.empty(sh.shape)
    new[:, 0] = (after - 0.5) / SH_DC
    luma, luma_before = after @ LUMINANCE, before @ LUMINANCE
    gain = np.minimum(luma / np.maximum(luma_before, 1e-3), LARGEST_GAIN) * finish.shine
    grey = (sh[:, 1:] @ LUMINANCE)[..., None]
    tint = after / np.maximum(luma, 1e-3)[:, None] if finish.tinted else np.ones_like(after)
    scale = gain[:, None, None] if finish.tinted else finish.shine
    new[:, 1:] = grey * scale * tint[:, None]
    return new
