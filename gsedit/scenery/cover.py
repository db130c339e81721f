"""Covers that lie on a scene: snow, frost and sand. `n` Gaussians."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import ColorChange, step
from gsedit.scenery.setting import LEAF, Setting
from gsedit.toolkit.grade import GAMMA

WHITE_SNOW, BLUE_SNOW = (1.0, 1.01, 1.03), (0.64, 0.74, 0.9)
"""Display colors of snow in full light, and in its shade."""
DRIFTS = 0.035
"""Standard deviation of the brightness of drifts."""
WINTER_SKY = (0.84, 0.87, 0.9)
SAND, DARK_SAND = (0.89, 0.75, 0.53), (0.62, 0.46, 0.3)
DESERT_SKY = (0.8, 0.83, 0.82)


def snow(setting: Setting) -> ColorChange:
    """Snow on what faces up and is open above; foliage is dusted, and steep sides stay."""
    soft = setting.noise(3 * LEAF, 1)
    lying = step(setting.rise + 0.1 * soft, 0.3, 0.62)
    dusted = step(setting.noise(LEAF, 2) + 0.8 * setting.rise, -0.5, 0.7)
    share = setting.sure * lying + (1 - setting.sure) * 0.85 * dusted
    share = share * step(setting.overhead, 0.12, 0.55)
    stems = setting.foliage * step(setting.noise(LEAF, 8), 0.2, 1.0)
    share = setting.found.surface.smoothed(share * (1 - 0.7 * stems), 1) * 0.97
    drifts = 1 + DRIFTS * setting.noise(3 * LEAF, 7)
    color = _between(BLUE_SNOW, WHITE_SNOW, setting.lit(0.1, 0.7))
    color = color * (setting.detail(0.35) * drifts)[:, None]
    return _covered(setting, share, color, WINTER_SKY, 0.7, 0.9)


def frost(setting: Setting) -> ColorChange:
    """Thin white crystals: on leaves most, on what faces up, a little on all that is open."""
    grain = step(setting.noise(LEAF / 2, 3) + 0.6 * setting.noise(2 * LEAF, 4), -1.2, 1.2)
    leaves = 1 - 0.5 * setting.sure
    share = (0.35 + 0.65 * grain) * leaves * (0.35 + 0.65 * step(setting.rise, -0.1, 0.8))
    share = (1.5 * share * (0.3 + 0.7 * step(setting.overhead, 0.1, 0.6))).clamp_max(0.9)
    color = _between((0.5, 0.64, 0.8), (0.86, 0.93, 0.99), setting.lit(0.15, 0.8))
    return _covered(setting, share, color * setting.detail(0.5)[:, None], WINTER_SKY, 0.7, 0.96)


def desert(setting: Setting) -> ColorChange:
    """Sand on the ground, dust on the rest; foliage dries to straw."""
    drift = step(setting.rise + 0.12 * setting.noise(4 * LEAF, 5), 0.45, 0.8)
    around = setting.found.surface.points - setting.found.place.center
    low = step(around @ setting.found.place.up / setting.found.place.distance, 0.05, -0.12)
    ground = drift * (0.35 + 0.6 * low) * (0.3 + 0.7 * setting.sure)
    dry = 0.85 * setting.foliage
    share = 1 - (1 - ground) * (1 - dry) * (1 - 0.16)
    color = _between(DARK_SAND, SAND, setting.lit(0.2, 0.9)) * setting.detail(0.6)[:, None]
    ripples = 1 + 0.03 * setting.noise(LEAF, 6) * ground
    return _covered(setting, share, color * ripples[:, None], DESERT_SKY, 0.9, 1.0)


def _between(
    low: tuple[float, ...], high: tuple[float, ...], share: Float[Tensor, " n"]
) -> Float[Tensor, "n 3"]:
    first, last = torch.tensor(low).double(), torch.tensor(high).double()
    return first + share[:, None] * (last - first)


def _covered(
    setting: Setting,
    share: Float[Tensor, " n"],
    color: Float[Tensor, "n 3"],
    sky: tuple[float, float, float],
    saturation: float,
    factor: float,
) -> ColorChange:
    """A cover over a scene, before a sky of a color; colors are as displayed in a light of 1."""
    found = setting.found
    present = found.surface.smoothed(found.light)
    near = found.trust * found.seen
    mean = (near @ present) / near.sum().clamp_min(1e-12)
    present = mean + found.trust * (present - mean)
    sky_part = 0.85 * setting.sky
    veil = 1 - (1 - share) * (1 - sky_part)
    mixed = ((1 - sky_part) * share * present ** (1 / GAMMA))[:, None] * color
    mixed = mixed + sky_part[:, None] * torch.tensor(sky).double()
    tint = mixed / veil.clamp_min(1e-12)[:, None]
    ones = torch.full((len(share), 3), factor, dtype=torch.float64)
    return ColorChange(saturation, ones, veil, tint)
