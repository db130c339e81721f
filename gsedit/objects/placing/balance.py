"""Brightness and white balance of an object that comes from other light. `n` Gaussians."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.objects.placing.daylight import dimmed
from gsedit.objects.placing.stance import Stance
from gsedit.scene.color_space import LUMINANCE
from gsedit.surface.directions import cell_areas, cell_directions
from gsedit.surface.surroundings import ROWS, Surroundings, surroundings_at
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

STUDIO = 0.35
"""Mean light, in the range [0, 1], of the white surroundings that a lone object is taken to have
been captured in."""
TRUSTED = 0.5
"""Power of the ratio of two lights that an object takes: colors of surroundings are of things too,
not of light only."""
BRIGHTER, TINTED = (0.6, 1.25), (0.9, 1.1)
"""Ranges of the linear factor of brightness, and of a channel against the others."""
NEAR = 0.6
"""Distance, of its height, within which nothing is seen from an object's middle."""
KNOWN = 0.15
"""Least share of what is above the horizon that must be seen for its light to be known."""


def balanced(
    body: Gaussians,
    stance: Stance,
    scene: Gaussians,
    up: Float[Tensor, "3"],
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
) -> Gaussians:
    """An object in the brightness and color of the light from above at its place.

    It is taken to come from a studio. Where little above the horizon is seen, it stays as it is.
    """
    middle = stance.foot + stance.height / 2 * stance.up
    near = NEAR * stance.height
    here = surroundings_at(scene, middle, near, up, execution, cameras)
    ours = None if here.studio else _from_above(here, up)
    if ours is None:
        return body
    theirs = torch.full((3,), STUDIO, dtype=torch.float64)
    return dimmed(body, gain(ours, theirs).expand(len(body), 3))


def gain(ours: Float[Tensor, "3"], theirs: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """Linear factors a channel that take an object from one light to another, bounded."""
    weights = torch.from_numpy(LUMINANCE / LUMINANCE.sum())
    bright = ((ours @ weights) / (theirs @ weights)).clamp_min(1e-3) ** TRUSTED
    tint = (ours / (ours @ weights)) / (theirs / (theirs @ weights))
    tint = (tint.clamp_min(1e-3) ** TRUSTED).clamp(*TINTED)
    return bright.clamp(*BRIGHTER) * tint


def _from_above(here: Surroundings, up: Float[Tensor, "3"]) -> Float[Tensor, "3"] | None:
    """Mean light on a level place from what was seen above the horizon; None where little was."""
    rise = (cell_directions(ROWS).double() @ up).clamp_min(0)
    area = cell_areas(ROWS).double() * rise
    weight = area * here.seen.double()
    if float(weight.sum()) < KNOWN * float(area.sum()):
        return None
    return (here.radiance.double() * weight[..., None]).sum((0, 1)) / weight.sum()
