"""A backdrop of one color, as of photos of an object before a wall, told from the object.

A fit must draw it somewhere, and draws some of it beside the object's outline, in the air: no depth
and no other view tells it from the object there, but its color does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import label
from torch import Tensor

from gsedit.meshing.fuse import Ball
from gsedit.surface.depth import SeenSurface

LEAST = 0.05
"""Share of the pixels from which what is behind a scene may be a backdrop."""
EVEN, ALIKE = 0.9, 0.04
"""Share of what is behind that has the backdrop's color, and the largest difference of a channel,
ten levels of 256: fits of even backdrops stay below a fourth of it."""


def backdrop_color(surfaces: Sequence[SeenSurface], ball: Ball) -> Float[Tensor, "3"] | None:
    """The one color, in [0, 1], of all that is seen outside of the ball; None where it has several,
    or is hardly seen."""
    behind = [s.seen & ~ball.holds(s.points, s.spread) for s in surfaces]
    colors = torch.cat([_shown(s)[some] for s, some in zip(surfaces, behind)])
    if len(colors) < max(1.0, LEAST * sum(s.depth.numel() for s in surfaces)):
        return None
    color = colors.median(0).values
    even = _alike(colors, color).double().mean()
    return color if float(even) >= EVEN else None


def before_backdrop(surface: SeenSurface, color: Float[Tensor, "3"], ball: Ball) -> SeenSurface:
    """The surface without the backdrop, of whose rays nothing is known then: all that has its color
    and goes on to what is behind the ball."""
    alike = _alike(_shown(surface), color) & surface.seen
    behind = alike & ~ball.holds(surface.points, surface.spread)
    parts = np.zeros(alike.shape, np.int32)
    label(alike.numpy(), output=parts)  # 0 where not alike
    gone = torch.from_numpy(np.isin(parts, np.unique(parts[behind.numpy()])))
    return replace(surface, depth=surface.depth.masked_fill(gone, 0))


def _shown(surface: SeenSurface) -> Float[Tensor, "h w 3"]:
    """Colors without what shines through."""
    return surface.color / surface.alpha[..., None].clamp_min(0.5)


def _alike(colors: Float[Tensor, "*b 3"], color: Float[Tensor, "3"]) -> Bool[Tensor, "*b"]:
    return (colors - color).abs().amax(-1) < ALIKE
