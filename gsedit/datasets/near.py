"""Near planes in proportion to a scene, whatever its unit of length.

The renderer's own, 0.01 world units, suits captures in metres or of a few units. A scene in
kilometers lies before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsedit.datasets.dataset import Dataset
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.scene.framing import NEAR_SHARE, bounds
from rasterizer.numerics import DEFAULT
from rasterizer.scene import Gaussians

TOO_FAR_SHARE = 0.05
"""A given camera keeps the renderer's near plane where that is at most this share of the radius."""


def viewpoints_near(viewpoints: Sequence[Viewpoint], scene: Gaussians) -> tuple[Viewpoint, ...]:
    """Give recorded cameras a nearer near plane where the scene's units need one.

    They keep 0.01 unless that is more than a twentieth of the radius of the scene's bulk. Raises
    UsageError for an empty scene.
    """
    near = _needed(bounds(scene).radius)
    if near is None:
        return tuple(viewpoints)
    return tuple(replace(each, camera=replace(each.camera, near=near)) for each in viewpoints)


def dataset_near(dataset: Dataset) -> Dataset:
    """Give the cameras of photos a nearer near plane where the units of the sparse points need one.

    Without points, all stays.
    """
    if dataset.points is None or not len(dataset.points):
        return dataset
    distance = (dataset.points - dataset.points.median(0).values).norm(dim=-1)
    near = _needed(float(distance.median()))
    if near is None:
        return dataset
    views = tuple(view.seen_by(replace(view.camera, near=near)) for view in dataset.views)
    return replace(dataset, views=views)


def _needed(radius: float) -> float | None:
    """None where the renderer's own near plane does, and where a scene has no extent."""
    too_far = 0 < radius < torch.inf and DEFAULT.near > TOO_FAR_SHARE * radius
    return NEAR_SHARE * radius if too_far else None
