"""Selections of the benchmark: clicks, each at the middle of the largest error, and phrases.

`n` Gaussians, `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bench.staged import Labelled, Stage
from gsedit.scene.color_space import lab_of_srgb
from gsedit.select.click import Click, Selector
from gsedit.select.phrase import find_phrase
from gsedit.select.region import Region, coverage
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC
from rasterizer.render import render
from rasterizer.scene import Gaussians

CLICKS = 3
NEAR_COLOR = 20.0
"""CIELAB distance up to which the baseline takes a Gaussian for one of the clicked color."""
SHOWN = 0.5
"""Share of a pixel that a selection must give to be seen there."""


class Clicked(NamedTuple):
    """A pixel of a view, and whether it is on the thing."""

    view: int
    x: float
    y: float
    inside: bool


Selecting = Callable[[Gaussians, Sequence[Camera], Sequence[Clicked]], Bool[Tensor, " n"]]


def iou(found: Bool[Tensor, " n"], true: Bool[Tensor, " n"]) -> float:
    """Gaussians in both over those in either; 0 for two empty ones."""
    return float((found & true).sum() / (found | true).sum().clamp_min(1))


def clicking(
    stage: Stage, given: Labelled, name: str, cameras: Sequence[Camera], select: Selecting
) -> list[float]:
    """IoU with the true thing after one click, two and so on.

    The first click is at the innermost pixel of the thing in the view that shows most of it. Each
    one that follows is at the innermost pixel of the largest error of the selection in any view.
    """
    true = given.of(name)
    masks = torch.stack([stage.mask(camera, name) for camera in cameras])
    view = int(masks.sum((1, 2)).argmax())
    clicks = [Clicked(view, *_innermost(masks[view])[1:], inside=True)]
    values = []
    while True:
        found = select(given.scene, cameras, clicks)
        values.append(iou(found, true))
        if len(values) == CLICKS:
            return values
        shown = torch.stack([_shown(given.scene, found, camera) for camera in cameras])
        clicks.append(_correction(shown, masks))


def select_at(
    scene: Gaussians, cameras: Sequence[Camera], clicks: Sequence[Clicked]
) -> Bool[Tensor, " n"]:
    """The selection by gsedit's clicks."""
    asked = [Click(cameras[each.view], each.x, each.y, each.inside) for each in clicks]
    return Selector(scene, cameras).at(asked).inside


def nearest_color(
    scene: Gaussians, cameras: Sequence[Camera], clicks: Sequence[Clicked]
) -> Bool[Tensor, " n"]:
    """All Gaussians whose color is near that of a click inside, and nearer than to any outside."""
    colors = torch.from_numpy(lab_of_srgb((scene.sh[:, 0] * SH_DC + 0.5).clamp(0, 1).numpy()))
    inside, outside = [], [torch.full((len(scene),), NEAR_COLOR, dtype=colors.dtype)]
    for each in clicks:
        pixel = render(scene, cameras[each.view]).color[int(each.y), int(each.x)].clamp(0, 1)
        asked = torch.from_numpy(lab_of_srgb(pixel[None].numpy()))
        (inside if each.inside else outside).append((colors - asked).norm(dim=-1))
    return torch.stack(inside).amin(0) < torch.stack(outside).amin(0)


def select_phrase(scene: Gaussians, cameras: Sequence[Camera], phrase: str) -> Bool[Tensor, " n"]:
    """The selection by gsedit's reader of phrases. Raises UsageError for one that names nothing."""
    return find_phrase(phrase, scene, cameras).inside


def _shown(scene: Gaussians, inside: Bool[Tensor, " n"], camera: Camera) -> Bool[Tensor, "h w"]:
    share: Float[Tensor, "h w"] = coverage(Region(inside), scene, camera)
    return share > SHOWN


def _correction(shown: Bool[Tensor, "v h w"], masks: Bool[Tensor, "v h w"]) -> Clicked:
    """A click at the innermost pixel of the largest error."""
    best = (-1.0, Clicked(0, 0.5, 0.5, inside=True))
    for view, (found, true) in enumerate(zip(shown, masks)):
        for error, inside in ((true & ~found, True), (found & ~true, False)):
            depth, x, y = _innermost(error)
            if depth > best[0]:
                best = (depth, Clicked(view, x, y, inside))
    return best[1]


def _innermost(mask: Bool[Tensor, "h w"]) -> tuple[float, float, float]:
    """The pixel of a mask that is farthest from its border: (distance, x, y)."""
    from scipy.ndimage import distance_transform_edt

    padded = torch.nn.functional.pad(mask, (1, 1, 1, 1)).numpy()
    depth = torch.from_numpy(np.asarray(distance_transform_edt(padded)))[1:-1, 1:-1]
    y, x = divmod(int(depth.argmax()), mask.shape[1])
    return float(depth.max()), x + 0.5, y + 0.5
