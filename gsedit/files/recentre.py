"""Captures far from the origin, as georeferenced ones are: their frame is moved in float64.

float32, in which scenes are kept and drawn, has a step of 0.5 at 5e6.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log10

import torch
from jaxtyping import Float
from torch import Tensor

FAR = 100.0
"""Distance of the cameras from the origin, in multiples of how far they spread, above which the
frame is moved. At that distance a step of float32 is 1e-5 of the spread."""


def offset_of(world_to_cameras: Sequence[Float[Tensor, "4 4"]]) -> Float[Tensor, "3"]:
    """What to subtract from world coordinates (float64): 0 unless the cameras are far away.

    Round numbers near the middle of the cameras, so that they stay the same where a few photos are
    added or left out, and are exact in float32 and in decimals.
    """
    none = torch.zeros(3, dtype=torch.float64)
    if len(world_to_cameras) < 2:
        return none
    poses = torch.stack([pose.double() for pose in world_to_cameras])
    centres = -(poses[:, :3, :3].mT @ poses[:, :3, 3:])[..., 0]
    middle = centres.mean(0)
    spread = float((centres - middle).norm(dim=-1).max())
    if spread == 0 or float(middle.norm()) < FAR * spread:
        return none
    unit = 10.0 ** ceil(log10(spread))
    return (middle / unit).round() * unit
