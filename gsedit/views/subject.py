"""Which views show whole what a capture looks at.

`n` Gaussians, `v` views. A view's weight on a Gaussian is the sum of its blending weights in a
small picture (`gsedit.views.plan.survey`).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.plan import SAMPLE
from rasterizer.camera import Camera

FOCUS = 4
"""Power of the share of views that have a Gaussian in their frame: at 4, what a quarter of the
views frame weighs 1/256 of what all of them do."""
COMMON = 0.5
"""Share of the views that must have some Gaussian in their frame, all of them the same, for a
capture to have a subject. Below it, as in a room seen from inside, all Gaussians count."""
MARGIN = 0.02
"""Of the picture's sides: nearer to the border than that, a Gaussian is cut off."""
SMALL = 0.5
"""A view that shows less than this part of the typical view's area of the subject shows it badly:
from afar, or behind something."""


def wholeness(
    means: Float[Tensor, "n 3"], cameras: Sequence[Camera], weights: Float[Tensor, "v n"]
) -> Float[Tensor, " v"]:
    """How whole each view shows the subject, in [0, 1]; the best view has 1.

    The subject is what the cameras look at: a Gaussian counts by its weight in all views, times the
    share of views that have it in their frame, to the power `FOCUS`. A view shows the part of that
    which is in its frame; less of it where it shows less than `SMALL` of the typical area. It needs
    no common point of the optical axes: where all cameras see the same (a forward-facing capture)
    every view has about 1; where they look apart (a room: `COMMON`) the widest have most.
    """
    step = 1 + len(means) // SAMPLE
    means, weights = means[::step], weights[:, ::step]
    framed = torch.stack([_framed(means, camera) for camera in cameras]).to(weights)
    share = framed.mean(0)
    most = float(share.max())
    focus = (share / most) ** FOCUS if most >= COMMON else torch.ones_like(share)
    area = weights @ focus
    inside = framed @ (weights.sum(0) * focus)
    shown = area[area > 0]
    typical = shown.median() if len(shown) else area.new_ones(())
    whole = inside * (area / (SMALL * typical)).clamp(max=1)
    return whole / whole.max().clamp_min(1e-9)


def _framed(means: Float[Tensor, "n 3"], camera: Camera) -> Bool[Tensor, " n"]:
    """Which centres are before the camera and within its picture, less a margin."""
    xy, z = camera.project(means)
    size = xy.new_tensor((camera.width, camera.height))
    return (z > 0) & ((xy > MARGIN * size) & (xy < (1 - MARGIN) * size)).all(-1)
