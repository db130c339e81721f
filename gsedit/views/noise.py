"""Smooth noise in space: a sum of sines in directions that never repeat together, without a table
and the same everywhere. `n` points."""

from __future__ import annotations

from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.quaternions import even_directions


def noise(points: Float[Tensor, "n 3"], seed: int = 0, waves: int = 24) -> Float[Tensor, " n"]:
    """Smooth noise with features of about size 1, mean 0 and standard deviation 1.

    Fewer waves than 24 show stripes on what is wide.
    """
    generator = torch.Generator().manual_seed(seed)
    directions = torch.from_numpy(even_directions(waves)).to(points)
    lengths = pi * (0.7 + 0.8 * torch.rand(waves, generator=generator))
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator))[0].to(points)
    phase = 2 * pi * torch.rand(waves, generator=generator)
    angles = points @ (turn @ (directions * lengths[:, None].to(points)).T) + phase.to(points)
    return angles.sin().sum(-1) * (2 / waves) ** 0.5
