"""What a fit has reached at a moment: what both recipes give to be measured."""

from __future__ import annotations

from typing import NamedTuple

from rasterizer.scene import Gaussians


class Moment(NamedTuple):
    """A fit in progress. It shows the scene as it is: measure it before the fit goes on."""

    seconds: float
    """That the fit took so far."""
    steps: int
    scene: Gaussians
