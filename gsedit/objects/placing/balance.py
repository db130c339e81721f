"""Brightness and white balance of an object that comes from other light. `n` Gaussians."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.objects.placing.daylight import dimmed
from gsedit.objects.placing.stance import Stance
from gsedit.scene.color_space import LUMINANCE
from gsedit.surface.directions import cell_areas
from gsedit.surface.surroundings import ROWS, Surroundings, surroundings_at
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

STUDIO = 0.35
"""Mean light, in the range [0, 1], of the white surroundings that a lone object is taken to have
been captured in."""
TRUSTED = 0.6
"""Power of the ratio of two lights that an object takes: colors of surroundings are of things too,
not of light only."""
BRIGHTER, TINTED = (0.5, 1.5), (0.85, 1.18)
"""Ranges of the linear factor of brightness, and of a channel against the others."""
NEAR = 0.6
"""Distance, of its height, within which nothing is seen from an object's middle."""


def balanced(
    body: Gaussians,
    stance: Stance,
    scene: Gaussians,
    from_where: Gaussians,
    up: Float[Tensor, "3"],
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
) -> Gaussians:
    """An object in the brightness and color of the light at its place.

    `from_where` are the surroundings that it was captured in; it may be empty.
    """
    middle = stance.foot + stance.height / 2 * stance.up
    near = NEAR * stance.height
    here = surroundings_at(scene, middle, near, up, execution, cameras)
    ours = torch.full((3,), STUDIO, dtype=torch.float64) if here.studio else _mean(here)
    theirs = torch.full((3,), STUDIO, dtype=torch.float64)
    factor = gain(ours, theirs)
    return dimmed(body, factor.expand(len(body), 3))


def gain(ours: Float[Tensor, "3"], theirs: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """Linear factors a channel that take an object from one light to another, bounded."""
    weights = torch.from_numpy(LUMINANCE / LUMINANCE.sum())
    bright = ((ours @ weights) / (theirs @ weights)).clamp_min(1e-3) ** TRUSTED
    tint = (ours / (ours @ weights)) / (theirs / (theirs @ weights))
    tint = (tint.clamp_min(1e-3) ** TRUSTED).clamp(*TINTED)
    return bright.clamp(*BRIGHTER) * tint


def _mean(surroundings: Surroundings) -> Float[Tensor, "3"]:
    """Mean light of all directions that were seen."""
    weight = (cell_areas(ROWS).to(surroundings.seen) * surroundings.seen)[..., None].double()
    total = (surroundings.radiance.double() * weight).sum((0, 1))
    return (total / weight.sum().clamp_min(1e-12)).clamp_min(1e-3)
