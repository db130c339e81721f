"""Shapes that a fit allows: as wide as the photos can tell, and no needles.

A Gaussian that is thinner than the photos' pixels costs nothing in them and is a scratch where a
camera comes nearer (Yu et al. 2024, Mip-Splatting, section 4.1, who widen each Gaussian in the
loss). Here widths are held during the fit: the scene that is optimised is the one that is written.
"""

from __future__ import annotations

from math import log

import torch
from jaxtyping import Float
from torch import Tensor

LEAST_WIDTH = 0.3
"""Standard deviation along every axis, pixels of the photo that shows a Gaussian largest."""
LENGTH_A_PIXEL = 10.0
"""Longest axis, in lengths of the middle one for each pixel of the middle one: the thinner, the
shorter. Gaps between planks, which photos show, stay whole, and the granite of the bear has grains
and not scratches; with 3 lengths at any width gaps were rows of beads."""


@torch.no_grad()
def hold_shapes(log_scales: Float[Tensor, "n 3"], pixels: Float[Tensor, " n"]) -> None:
    """Widen what is thinner than LEAST_WIDTH pixels, shorten what is long for its width; in
    place."""
    log_pixels = pixels.log()[:, None]
    log_scales.clamp_min_(log(LEAST_WIDTH) + log_pixels)
    middle = log_scales.median(-1, keepdim=True).values
    log_scales.clamp_max_(2 * middle + log(LENGTH_A_PIXEL) - log_pixels)
