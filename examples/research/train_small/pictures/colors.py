"""Colors by hue, saturation and value, as linear rgb."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.vectors import Point

GAMMA = 2.2  # of the display that values are meant for


def color(hue: float, saturation: float, value: float) -> Point:
    """Linear rgb in [0, 1] of hue (in turns), saturation and value (as displayed), in [0, 1]."""
    six = hue % 1 * 6
    channels = (abs(six - 3) - 1, 2 - abs(six - 2), 2 - abs(six - 4))
    return tuple((value * (1 - saturation * (1 - _clip(c)))) ** GAMMA for c in channels)


def ramp(
    rng: RandomStream,
    hue: float,
    saturation: float,
    values: tuple[float, float],
    spread: float = 0.03,
) -> Float[Tensor, "5 3"]:
    """Linear rgb of about one hue (within `spread` turns), from the dark to the light value."""
    dark, light = values
    return torch.tensor(
        [
            color(
                hue + rng(-spread, spread),
                _clip(saturation + rng(-0.1, 0.1)),
                _clip(dark + (light - dark) * i / 4 + rng(-0.04, 0.04), 0.02),
            )
            for i in range(5)
        ]
    )


def _clip(share: float, least: float = 0.0) -> float:
    return min(max(share, least), 1.0)
