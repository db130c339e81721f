"""Light on an object with nothing around it: exposed so that it is seen against the dark.

`n` Gaussians.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.present import Survey
from gsedit.scene.color_space import LUMINANCE
from gsedit.toolkit.grade import GAMMA
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.scene import Gaussians

MIDDLE = 0.14
"""Mean linear luminance of a picture that is exposed well: of a display, 0.41."""
ADAPTED = 0.5
"""Power of what is missing to it that the exposure makes up: a night stays darker than a day."""
GLEAM = 0.05
"""Share of the light that is added which any surface throws back, whatever its color."""


def exposure(found: Survey, scene: Gaussians, ratio: Float[Tensor, "n 3"]) -> float:
    """Factor, at least 1, of the light on an object that is alone; 1 where something is around it.

    `ratio` is new light over present light. Stronger light stays brighter.
    """
    if not found.place.alone:
        return 1.0
    linear = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1) ** GAMMA * ratio
    seen = found.seen / found.seen.sum().clamp_min(1e-12)
    mean = float(seen @ (linear @ torch.from_numpy(LUMINANCE / LUMINANCE.sum())))
    return max(1.0, MIDDLE / max(mean, 1e-6)) ** ADAPTED


def gleaming(scene: Gaussians, light: Float[Tensor, "n 3"]) -> Gaussians:
    """The scene with the dull shine that shows the shape of what is black."""
    sh = scene.sh.detach().clone()
    color = sh_to_color(sh[:, 0].double())
    lit = (color.clamp_min(0) ** GAMMA + GLEAM * light) ** (1 / GAMMA)
    sh[:, 0] += ((lit - color.clamp_min(0)) / SH_DC).to(sh)
    return replace(scene, sh=sh)
