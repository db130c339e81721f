"""The region of an edit, voted by edited views: where nothing else tells it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.select.region import (
    MIN_SEEN_PIXELS,
    Lifted,
    Region,
    everything,
    lift,
    otsu,
    smoothed,
)
from gsedit.select.surfaces import neighbors
from rasterizer.camera import Camera
from rasterizer.numerics import Execution
from rasterizer.scene import Gaussians

MAX_OUTSIDE_SHARE = 0.25
"""Largest change outside, as a share of that inside: editors change surroundings a little."""


def vote_region(
    scene: Gaussians,
    cameras: Sequence[Camera],
    edited: Mapping[int, Float[Tensor, "h w 3"]],
    originals: Mapping[int, Float[Tensor, "h w 3"]],
    execution: Execution,
) -> Region:
    """The region that the editor changed, voted over the edited views.

    `cameras` are those of all views; `edited` and `originals` are pictures by index.
    """
    changes = [_change(image, originals[i]) for i, image in edited.items()]
    lifted = lift(scene, [cameras[i] for i in edited], changes, execution)
    inside = find_changed(scene, lifted)
    if inside is None:
        return Region(everything(scene).inside, "auto: the edit is of the whole scene")
    return Region(inside, "auto: what the edit changes")


def _change(
    edited: Float[Tensor, "h w 3"], original: Float[Tensor, "h w 3"]
) -> Float[Tensor, "h w"]:
    """The root mean square over the channels of the difference."""
    return torch.sqrt((edited - original).square().mean(-1))


def find_changed(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """Find the Gaussians that an edit changes, from the lifted size of the change.

    None where that is everything: outside, the change must be at most `MAX_OUTSIDE_SHARE` of that
    inside.
    """
    graph = neighbors(scene)
    scale = (
        float(lifted.mean[lifted.weight > MIN_SEEN_PIXELS].quantile(0.95)) if len(scene) else 0.0
    )
    if scale <= 0:
        return None
    values = smoothed(replace(lifted, mean=lifted.mean / scale), graph)
    inside = values > otsu(values, lifted.weight)
    means = [
        float((lifted.weight * values)[part].sum() / lifted.weight[part].sum().clamp_min(1e-9))
        for part in (inside, ~inside)
    ]
    return inside if means[1] < MAX_OUTSIDE_SHARE * means[0] else None
