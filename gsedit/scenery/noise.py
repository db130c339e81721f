"""Smooth noise in space. `n` points."""

from __future__ import annotations

from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.quaternions import even_directions

WAVES = 24
"""Plane waves that are summed: fewer show stripes."""


def noise(points: Float[Tensor, "n 3"], seed: int = 0) -> Float[Tensor, " n"]:
    """Smooth noise with features of about size 1, mean 0 and standard deviation 1."""
    generator = torch.Generator().manual_seed(seed)
    directions = torch.from_numpy(even_directions(WAVES)).to(points)
    lengths = pi * (0.7 + 0.8 * torch.rand(WAVES, generator=generator))
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator))[0].to(points)
    phase = 2 * pi * torch.rand(WAVES, generator=generator)
    waves = points @ (turn @ (directions * lengths[:, None].to(points)).T) + phase.to(points)
    return waves.sin().sum(-1) * (2 / WAVES) ** 0.5
