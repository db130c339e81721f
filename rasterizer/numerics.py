"""What a picture means (Numerics), how it is computed (Execution): every knob and its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

SH_DC = 0.28209479177387814  # Y_00 = 1 / (2 sqrt(pi)); INRIA's colour is 0.5 + SH_DC sh[0]


@dataclass(frozen=True)
class Numerics:
    """What the picture means. The defaults are gsplat's, but for the stop: scenes look the same."""

    alpha_max: float = 0.99
    """One splat never hides everything: (1 - 0.99)^2 is the stop threshold: two must be met."""
    alpha_min: float = 1 / 255
    """Below one step of an 8-bit picture a splat contributes nothing; bounds every footprint."""
    transmittance_min: float = 1e-5
    """A tile is finished when less than this shows through all its pixels: the largest error of a
    colour. 0: never, the whole sum. At gsplat's 1e-4 the gradients of opacities behind a nearly
    opaque splat, which divide what is left out by 1 - alpha, were wrong by 1.5e-3; a tenth of it
    costs 5 % more time and leaves 6e-5."""
    blur: float = 0.3
    """Pixel variance added to each projected covariance (EWA low-pass)."""
    antialiased: bool = False
    """Scale each opacity by sqrt(det(covariance) / det(covariance + blur)): what the blur spreads
    out is not added to the picture (Mip-Splatting, arXiv 2311.16493)."""
    near: float = 0.01
    """Splats whose centre is not farther than this are not drawn (world units along the view).
    Below 0 only for an orthographic camera."""
    far: float = math.inf
    """Splats whose centre is farther than this are not drawn."""
    radius_clip: float = 0.0
    """Splats are not drawn whose footprint reaches no more than this many pixels to its sides and
    up and down, rounded up to whole pixels: far away ones, for time."""
    margin: float = 0.3
    """The projection's Jacobian is taken at most this fraction of the half extent off the
    picture.
    """

    @property
    def log_alpha_max(self) -> float:
        return math.log(self.alpha_max)

    @property
    def log_alpha_min(self) -> float:
        return math.log(self.alpha_min)


DEFAULT = Numerics()


@dataclass(frozen=True)
class Execution:
    """How the picture is computed. Changes time, memory and rounding; nothing else."""

    tile_size: int | None = None
    """Side of a tile, pixels; None: chosen from the splats' footprints."""
    block: int | None = None
    """Gaussians of a tile that are blended at once; None: chosen from the lists' lengths."""
    cull: Literal["ellipse", "box"] = "ellipse"
    """A tile lists what its ellipse touches, or all whose bounding box does (more, for nothing)."""
    compile: bool = False
    """Blend with a compiled kernel: needs a C++ compiler, falls back with a warning without."""

    def __post_init__(self) -> None:
        for name in ("tile_size", "block"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} is {value}: give 1 or more, or None for a good one")
        if self.cull not in ("ellipse", "box"):
            raise ValueError(f"cull is {self.cull!r}: ellipse or box")


AUTO = Execution()
