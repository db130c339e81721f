"""Measurement of a fit at a moment, and the scene that both recipes give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gsedit.bench.provenance import Provenance
from rasterizer.scene import Gaussians


class Moment(NamedTuple):
    """A fit in progress. It shows the scene as it is: measure it before the fit goes on."""

    seconds: float
    """That the fit took so far."""
    steps: int
    scene: Gaussians


@dataclass(frozen=True)
class FitMeasurement:
    """Result of a recipe on a capture at a moment."""

    capture: str
    recipe: str
    seconds: float
    steps: int
    gaussians: int
    psnr: float
    ssim: float
    perceptual: float | None
    provenance: Provenance
