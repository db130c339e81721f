"""Foliage of the seasons: leaves change, clump by clump, and nothing else does. `n` Gaussians."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import ColorChange, step
from gsedit.scenery.setting import CLUMP, LEAF, Setting
from gsedit.toolkit.grade import GAMMA

AUTUMN = ((0.36, 0.34, 0.1), (0.86, 0.62, 0.1), (0.88, 0.44, 0.08), (0.7, 0.2, 0.08),
          (0.5, 0.3, 0.14))  # fmt: skip
SPRING = ((0.42, 0.62, 0.2), (0.58, 0.74, 0.26), (0.66, 0.78, 0.36))
SUMMER = ((0.16, 0.4, 0.1), (0.24, 0.5, 0.12), (0.36, 0.56, 0.14))
BLOSSOM = ((1.0, 0.78, 0.87), (0.98, 0.6, 0.75))
"""Display colors of foliage in middle light."""
BRIGHTEST = 0.93
"""Display color that foliage does not pass."""


def autumn(setting: Setting) -> ColorChange:
    """Leaves from green gold over orange to brown, by clump and by leaf."""
    turned = 0.5 + 0.3 * setting.noise(CLUMP, 11) + 0.14 * setting.noise(LEAF, 12)
    return _leaves(setting, ramp_of(AUTUMN, turned), 0.96)


def spring(setting: Setting) -> ColorChange:
    """Fresh leaves, and blossoms on some of the bushes."""
    fresh = ramp_of(SPRING, 0.5 + 0.3 * setting.noise(CLUMP, 13) + 0.1 * setting.noise(LEAF, 14))
    petals = step(setting.noise(3 * CLUMP, 15), -0.1, 0.15)  # finer ones mix to brown
    petals = petals * (1 - step(setting.found.surface.confidence, 0.93, 0.99))
    pink = ramp_of(BLOSSOM, 0.5 + 0.4 * setting.noise(CLUMP, 18))
    return _leaves(setting, torch.lerp(fresh, pink, petals[:, None]), 0.96, petals)


def summer(setting: Setting) -> ColorChange:
    """Full, deep green leaves."""
    deep = ramp_of(SUMMER, 0.5 + 0.3 * setting.noise(CLUMP, 19) + 0.1 * setting.noise(LEAF, 20))
    return _leaves(setting, deep, 0.7)


def ramp_of(
    colors: tuple[tuple[float, float, float], ...], at: Float[Tensor, " n"]
) -> Float[Tensor, "n 3"]:
    """Colors along a ramp, from 0 to 1."""
    table = torch.tensor(colors, dtype=torch.float64)
    place = at.clamp(0, 1) * (len(table) - 1)
    low = place.long().clamp_max(len(table) - 2)
    return torch.lerp(table[low], table[low + 1], (place - low)[:, None])


def _leaves(
    setting: Setting,
    color: Float[Tensor, "n 3"],
    strength: float,
    light: Float[Tensor, " n"] | None = None,
) -> ColorChange:
    """Foliage in other colors, as bright against each other as its leaves are; where `light` is 1,
    as bright as the color is."""
    leaves = setting.foliage
    middle = setting.luminance[leaves > 0.5].median() if bool((leaves > 0.5).any()) else 0.2
    shade = ((setting.luminance + 0.005) / (middle + 0.005)).clamp(0.05, 2.2) ** (1 / GAMMA)
    if light is not None:
        shade = torch.lerp(shade, shade.clamp_min(1.0), light)
    lit = (color * shade[:, None]).clamp_max(BRIGHTEST)
    ones = torch.ones(len(leaves), 3, dtype=torch.float64)
    return ColorChange(1.0, ones, strength * leaves, lit)
