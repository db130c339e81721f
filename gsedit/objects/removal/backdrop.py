"""The background of an object that is no plane: depth and texture continued in a view.

`h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.objects.removal.cells import away_from
from gsedit.objects.removal.complete import complete
from gsedit.objects.removal.draw import Draw, drawn_over
from gsedit.objects.removal.fill import DISC, FLATNESS, OPACITY
from gsedit.objects.removal.membrane import solve_membrane
from gsedit.objects.removal.sight import Sight, Views, seen_through
from gsedit.scene.quaternions import quaternion_of
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians

LEAST_HOLE = 0.01
"""Least hole, of the object's outline: less is not worth a layer."""
SOLID = 0.5
"""Opacity of a pixel, below which it is open."""
SURROUNDED = 0.8
"""Opacity that what is around must continue to: else there is nothing behind the object."""
KNOWN = 0.9
"""Opacity of a pixel that is known."""
SURROUNDINGS = 1.0
"""Width of what is known around a hole that is looked at, of the hole's size."""


@dataclass(frozen=True, eq=False)
class Gap:
    """A hole in a view."""

    camera: Camera
    hole: Bool[np.ndarray, "h w"]


def find_gap(views: Views) -> Gap | None:
    """The view with the largest hole in the object's outline, and that hole; None: none has any.

    Where nothing is around the outline, there is no hole: the object was before nothing.
    """
    best, largest = None, 0.0
    for sight, alpha in zip(views.sights, views.alpha):
        around = sight.ring | ~sight.outline
        open_ = sight.outline & (alpha < SOLID)
        if open_.sum() <= max(LEAST_HOLE * sight.outline.sum(), largest) or not around.any():
            continue
        full = solve_membrane(alpha[..., None].astype(np.float64), sight.outline, around)[..., 0]
        hole = open_ & (full > SURROUNDED)
        if hole.sum() > max(LEAST_HOLE * sight.outline.sum(), largest):
            best, largest = Gap(sight.camera, hole), float(hole.sum())
    return best


@torch.no_grad()
def backdrop(
    scene: Gaussians,
    gap: Gap,
    sights: Sequence[Sight],
    draw: Draw | None = None,
    execution: Execution = AUTO,
) -> tuple[Gaussians, bool]:
    """A layer of Gaussians, one a pixel of the hole, and whether it has texture.

    Inverse depth goes on smoothly from what is around.
    """
    camera, hole = gap.camera, gap.hole
    shown = render(scene, camera, median_depth=True, execution=execution)
    depth = shown.median_depth
    assert depth is not None
    solid = (shown.alpha.numpy() > KNOWN) & (depth.numpy() > 0)
    size = float(np.sqrt(hole.sum()))
    known = solid & ~hole & (away_from(hole) < 3 + SURROUNDINGS * size)
    done = complete(shown.color.double().numpy(), known, hole)
    picture = done.picture
    if draw is not None:
        picture = drawn_over(picture, known, hole, draw)
    inverse = 1 / np.where(known, depth.double().numpy(), 1.0)
    smooth = solve_membrane(inverse[..., None], hole, known)[hole][:, 0]
    far = torch.from_numpy(1 / np.maximum(smooth, 1e-9))
    made = _layer(scene, camera, hole, far, torch.from_numpy(picture[hole]))
    empty = seen_through(made.means.double().numpy(), sights)
    return made[torch.from_numpy(~empty)], done.textured


def _layer(
    scene: Gaussians,
    camera: Camera,
    hole: Bool[np.ndarray, "h w"],
    depth: Float[Tensor, " m"],
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Discs that face the camera, as wide as their pixels."""
    count = len(depth)
    points = camera.unproject(camera.pixel_centers()[torch.from_numpy(hole)], depth)
    sh = torch.zeros(count, scene.sh.shape[1], 3).double()
    sh[:, 0] = color_to_sh(colors)
    pixel = (
        depth / camera.fx if camera.model == "pinhole" else torch.full_like(depth, 1 / camera.fx)
    )
    flat = torch.tensor((1.0, 1.0, FLATNESS)).double()
    quat = torch.from_numpy(quaternion_of(camera.rotation.double().numpy().T))
    return Gaussians(
        points,
        quat.expand(count, 4).contiguous(),
        (DISC * pixel[:, None] * flat).log(),
        torch.full((count,), OPACITY).double().logit(),
        sh,
    ).to(scene.means.dtype)
