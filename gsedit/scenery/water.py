"""Water: on a scene, which it darkens, and over it, through which light is bent. `n` Gaussians."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import ColorChange, step
from gsedit.scenery.setting import LEAF, Setting
from gsedit.toolkit.grade import GAMMA

SOAKED = 0.62
"""Share of its light that soaked stone or soil loses: water fills the pores that scatter it."""
CAUSTIC = 0.55
"""Gain of light where waves focus it."""


def wetness(setting: Setting) -> Float[Tensor, " n"]:
    """How wet each Gaussian is, in [0, 1]: what faces up and is open above; sides in streaks."""
    flat = step(setting.rise, 0.15, 0.75)
    streaks = 0.55 * step(setting.noise(3 * LEAF, 21), -0.8, 0.8)
    open_above = step(setting.overhead, 0.1, 0.5)
    return torch.maximum(flat, streaks) * (0.25 + 0.75 * open_above) * (1 - setting.sky)


def puddles(setting: Setting) -> Float[Tensor, " n"]:
    """Share of standing water: in hollows of what is level."""
    level = step(setting.rise, 0.9, 0.97) * setting.sure
    return level * step(setting.noise(6 * LEAF, 22), 0.2, 0.7) * wetness(setting)


def wet(setting: Setting) -> ColorChange:
    """Soaked surfaces: darker and more saturated; standing water darkest."""
    soaked = wetness(setting) * (1 - 0.6 * setting.foliage)
    linear = 1 - SOAKED * soaked - 0.2 * puddles(setting)
    factor = linear.clamp_min(0.1) ** (1 / GAMMA)
    return _times(1.12, factor)


def caustics(setting: Setting) -> ColorChange:
    """A net of light on what faces up, as below waves."""
    size = 5 * LEAF
    ridges = torch.exp(-6 * setting.noise(size, 23).abs()) + torch.exp(
        -6 * setting.noise(0.8 * size, 24).abs()
    )
    net = CAUSTIC * ridges * step(setting.rise, 0.0, 0.8) * setting.found.trust
    factor = (0.85 + net) ** (1 / GAMMA)
    return _times(1.0, factor)


def _times(saturation: float, factor: Float[Tensor, " n"]) -> ColorChange:
    """Display colors, more or less saturated, times a factor."""
    colors = factor[:, None].expand(-1, 3)
    return ColorChange(saturation, colors, torch.zeros_like(factor), torch.zeros_like(colors))
