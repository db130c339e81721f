"""Matches of two views alone, as `correspond` finds them for every two of many."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.consistency.correspond import Pairs, cell_surfaces, mutual
from gsedit.views.depth_maps import DEFAULT_RULES, Visibility
from rasterizer.camera import Camera


@torch.no_grad()
def match(
    camera_a: Camera,
    depth_a: Float[Tensor, "h w"],
    alpha_a: Float[Tensor, "h w"],
    camera_b: Camera,
    depth_b: Float[Tensor, "h2 w2"],
    alpha_b: Float[Tensor, "h2 w2"],
    cell: int = 8,
    rules: Visibility = DEFAULT_RULES,
) -> Pairs:
    """Mutual matches between the cells of two views; symmetric in them. Raises UsageError.

    The center of each cell is carried through the world to the other view and takes the *nearest*
    cell there (interpolating noise would lower its variance). A pair is accepted when each cell is
    the other's nearest and every rule of `Visibility` holds in both directions.
    """
    a = cell_surfaces(camera_a, depth_a, alpha_a, cell, rules)
    b = cell_surfaces(camera_b, depth_b, alpha_b, cell, rules)
    return mutual(a, b, rules)
