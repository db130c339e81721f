"""Films and sensors: each brightness has its color, the same from every side. `n` Gaussians."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import ColorChange
from gsedit.scenery.seasons import ramp_of
from gsedit.scenery.setting import Setting
from gsedit.toolkit.grade import GAMMA

HEAT = ((0.02, 0.0, 0.12), (0.2, 0.02, 0.45), (0.62, 0.08, 0.5), (0.93, 0.28, 0.22),
        (0.99, 0.62, 0.1), (1.0, 0.9, 0.35), (1.0, 1.0, 0.88))  # fmt: skip
"""Colors of a thermal camera, from cold to hot."""
FADED = ((0.12, 0.1, 0.14), (0.98, 0.95, 0.86))
"""Black and white of an instant photo."""
LIFT = 0.12
"""Share of the black that lies over the picture as a veil."""


def thermal(setting: Setting) -> ColorChange:
    """Colors of a thermal camera; what is bright is hot, and leaves are cold."""
    heat = spread(setting) * (1 - 0.35 * setting.foliage)
    color = ramp_of(HEAT, heat)
    return ColorChange(1.0, torch.ones_like(color), torch.ones_like(heat), color)


def polaroid(setting: Setting) -> ColorChange:
    """Faded blacks and creamy whites of an instant photo."""
    black, white = (torch.tensor(each).double() for each in FADED)
    factor = ((white - black) / (1 - LIFT)).expand(len(setting.scene), 3)
    veil = torch.full((len(setting.scene),), LIFT).double()
    return ColorChange(0.72, factor, veil, (black / LIFT).expand_as(factor))


def spread(setting: Setting) -> Float[Tensor, " n"]:
    """Brightness from 0 for the darkest to 1 for the brightest parts of what is seen."""
    luma = setting.found.surface.smoothed(setting.luminance) ** (1 / GAMMA)
    weight = setting.found.seen
    order = luma.argsort()
    rank = weight[order].cumsum(0) / weight.sum().clamp_min(1e-12)
    low, high = (
        luma[order[int(torch.searchsorted(rank, share).clamp_max(len(luma) - 1))]]
        for share in (0.02, 0.98)
    )
    return ((luma - low) / (high - low).clamp_min(1e-6)).clamp(0, 1)
